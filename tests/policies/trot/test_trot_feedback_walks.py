"""The trot with feedback in episodes: that it walks, and where it does what it is asked."""

import pytest

import policies
from evaluate.measures.metrics import measure
from evaluate.rollouts import rollout
from quad_env.scenarios.axes import AXES
from quad_env.seeding import episode_seeds
from train.curriculum import practice


def walk(axis, severity, count, policy, steps=400):
    scenario = practice(AXES[axis].scenario(severity, axis), "search")
    return measure(rollout.run(policy, scenario, episode_seeds("search", 3, count), steps=steps))


def test_on_flat_ground_it_follows_commands_without_falling_and_without_a_steady_error():
    measures = walk("flat", 1.5, 6, policies.make("trot_feedback"))
    assert not measures.fell.any()
    assert measures.velocity_error.mean() <= 0.08
    assert measures.mean_velocity_error.mean() <= 0.03
    assert measures.yaw_rate_error.mean() <= 0.15


@pytest.mark.parametrize(("axis", "severity"), [("rough", 0.12), ("slippery", 0.1)])
def test_it_mostly_does_what_it_is_asked_where_the_trot_mostly_does_not(axis, severity):
    feedback, trot = (
        walk(axis, severity, 8, policies.make(name)).succeeded.mean() for name in ("trot_feedback", "trot")
    )
    assert feedback >= 0.5
    assert feedback >= trot + 0.3
