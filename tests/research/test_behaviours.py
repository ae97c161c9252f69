"""Jump, recovery and safety layer have the results of the studies in a few episodes."""

import numpy as np
import pytest

import policies
from evaluate.measures.metrics import measure
from evaluate.rollouts.rollout import run
from policies.behaviour import Behaviour, motion
from policies.safety import Safe
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.physics.simulation import ALL, Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES
from quad_env.seeding import episode_seeds
from research.studies import jump, recovery
from research.studies.recovery import is_standing


def test_a_jump_rises_and_lands_standing_but_not_without_its_thrust(monkeypatch) -> None:
    policy = Behaviour(follow=False)
    outcome = jump.run_jump(policy, episode_seeds("search", 9, 4))
    assert outcome.rise.min() >= 0.15
    assert outcome.peak_torque <= SIMPLE_QUAD.rated_torque
    assert "landed standing: 4 of 4" in jump.format_result(outcome)
    crouch, *_, stand = motion.jump_keyframes(SIMPLE_QUAD)
    monkeypatch.setattr(motion, "jump_keyframes", lambda _: (crouch, stand))
    outcome = jump.run_jump(Behaviour(follow=False), episode_seeds("search", 9, 2))
    assert outcome.rise.max() < 0.05
    assert "landed standing: 0 of 2" in jump.format_result(outcome)


def test_a_robot_whose_simulation_diverges_in_the_air_has_not_landed(monkeypatch) -> None:
    """The robot is reset to the home pose after the divergence, and must not count as landed."""
    read = Simulation.read_coordinates

    def first_one_diverges(self, ids=ALL):
        coordinates, diverged = read(self, ids)
        first = np.arange(len(self.qpos))[ids] == 0
        return coordinates, diverged | (first & (self.qpos[ids, 2] > SIMPLE_QUAD.home_height + 0.16))

    monkeypatch.setattr(Simulation, "read_coordinates", first_one_diverges)
    outcome = jump.run_jump(Behaviour(follow=False), episode_seeds("search", 9, 2))
    assert outcome.rise.min() >= 0.15
    assert "landed standing: 1 of 2" in jump.format_result(outcome)


def test_nearly_every_robot_gets_up_from_any_pose() -> None:
    """At the rate of the study, 99.6 %, fewer than 30 of 32 robots get up in 0.03 % of samples; at 90 % in 63 %."""
    outcome = recovery.run_recovery(episode_seeds("search", 3, 32))
    assert (outcome.standing_since <= 5.0).sum() >= 30
    assert outcome.peak_torque <= SIMPLE_QUAD.rated_torque + 1e-9
    assert "of 32" in recovery.format_result(outcome)


@pytest.mark.parametrize(
    ("tilt", "height", "speed", "turning", "diverged", "expected"),
    [
        (9.0, 0.46, 0.29, 0.29, False, True),
        (11.0, 0.46, 0.0, 0.0, False, False),
        (0.0, 0.44, 0.0, 0.0, False, False),
        (0.0, 0.5, 0.31, 0.0, False, False),
        (0.0, 0.5, 0.0, 0.31, False, False),
        (0.0, 0.5, 0.0, 0.0, True, False),  # reset to the home pose
    ],
)
def test_a_robot_stands_that_is_upright_high_and_still(tilt, height, speed, turning, diverged, expected) -> None:
    observation = np.zeros((1, OBSERVATION_SIZE), np.float32)
    lean = np.deg2rad(tilt)
    observation[:, OBSERVATION["projected_gravity"]] = (np.sin(lean), 0.0, -np.cos(lean))
    observation[:, OBSERVATION["linear_velocity"]] = (0.0, -speed, 0.0)
    observation[:, OBSERVATION["angular_velocity"]] = (0.0, 0.0, -turning)
    infos = {"height": np.array([height]), "diverged": np.array([diverged])}
    assert is_standing(observation, infos).tolist() == [expected]


def test_pushed_robots_that_fall_alone_recover_with_the_safety_layer() -> None:
    where, seeds = AXES["push"].scenario(65.0, "push"), episode_seeds("search", 0, 8)
    alone, guarded = (
        measure(run(policy, where, seeds, steps=600)).fell
        for policy in (policies.make("trot"), Safe(policies.make("trot")))
    )
    assert alone.sum() >= 3
    assert guarded.sum() <= 1
