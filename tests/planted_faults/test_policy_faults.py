"""Faults of controllers that stay upright without following their commands."""

from dataclasses import replace

from evaluate.rollouts import rollout
from policies.virtual_model.parameters import VirtualParameters, searched_parameters
from policies.virtual_model.policy import TrotFeedback
from quad_env import CommandRanges
from quad_env.seeding import episode_seeds
from train.curriculum import with_terrain_seed

AHEAD = CommandRanges(forward=(0.5, 0.5), lateral=(0.0, 0.0), yaw_rate=(0.0, 0.0), zero_fraction=0.0)


def speed_on_rough_ground(parameters: VirtualParameters) -> float:
    """Return the mean forward velocity after 2 s of 4 robots at a command of 0.5 m/s on nominal rough ground, m/s."""
    scenario = replace(with_terrain_seed("rough", "search"), commands=AHEAD)
    episodes = rollout.run(TrotFeedback(parameters), scenario, episode_seeds("search", 5, 4), nthread=1, steps=450)
    return float(episodes.heading_velocity[200:, :, 0].mean())


def test_trot_feedback_walks_on_nominal_rough_ground_as_told() -> None:
    assert speed_on_rough_ground(searched_parameters()) > 0.3


def test_a_twentieth_of_the_forward_gain_is_seen() -> None:
    found = searched_parameters()
    assert speed_on_rough_ground(replace(found, forward_damping=found.forward_damping / 20)) < 0.3
