"""Reward terms of a user's own: weight times value times control period at every step, or a line that says why not."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

import quad_env
from quad_env.columns import sum_of_squares, total
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.state import Feet, QuadState
from quad_env.task.rewards import RewardTermError

HOME = quad_env.SIMPLE_QUAD.home_pose.astype(np.float32)
LOW = np.tile(np.float32([0, -1.5, 0]), 4)
"""Joint targets that let the trunk down to the ground, rad."""


def joint_speed(state: QuadState[Any]) -> Any:
    return sum_of_squares(state.joint_velocity)


def foot_speed(state: QuadState[Any], feet: Feet[Any]) -> Any:
    return total(map(sum_of_squares, feet.velocity)) * (state.height > 0.0)


def task(function: Callable[[Any], Any], weight: float = -0.25, **options: Any) -> quad_env.TaskConfig:
    return quad_env.TaskConfig(reward_terms=(quad_env.RewardTerm("mine", function, weight),), **options)


@pytest.mark.parametrize("function", [joint_speed, partial(foot_speed), lambda state: state.height])
def test_one_robot_is_paid_as_in_a_batch_to_the_bit_and_no_other_number_changes(function: Callable[..., Any]) -> None:
    config = task(function)
    one, batch = SimpleQuadEnv("rough", config=config), SimpleQuadVectorEnv(2, "rough", config=config)
    plain = SimpleQuadVectorEnv(2, "rough")
    for env in (one, batch, plain):
        env.reset(seed=3)
    for _ in range(5):
        mine, both, without = one.step(LOW), batch.step(np.array([LOW, HOME])), plain.step(np.array([LOW, HOME]))
        assert (mine[1], mine[4]["reward_mine"]) == (both[1][0], both[4]["reward_mine"][0])
        np.testing.assert_array_equal(both[0], without[0])
        for key in without[4]:
            np.testing.assert_array_equal(both[4][key], without[4][key])
    assert mine[4]["reward_mine"] < 0.0


def test_feet_are_looked_at_where_a_term_asks_for_them() -> None:
    def asked(function: Callable[..., Any], weight: float = 0.0) -> bool:
        weights = quad_env.RewardWeights(foot_slip=weight)
        simulation = SimpleQuadEnv(config=task(function, reward_weights=weights)).simulation
        return simulation.state_of_one((0.0, 0.0, 0.0)).feet is not None

    assert not asked(joint_speed)
    assert not asked(np.add.reduce)  # has no signature
    assert asked(foot_speed)
    assert asked(joint_speed, -0.1)


def test_a_robot_that_waits_for_its_reset_is_not_asked_about_and_earns_nothing() -> None:
    asked = []

    def count(state: QuadState[Any]) -> Any:
        asked.append(len(state.height))
        return np.ones_like(state.height)

    env = SimpleQuadVectorEnv(2, autoreset_mode="DISABLED", config=task(count), nthread=1)
    env.reset(seed=0)
    terminated = np.zeros(2, bool)
    while not terminated.any():
        terminated = env.step(np.array([LOW, HOME]))[2]
    infos = env.step(np.array([LOW, HOME]))[4]
    assert infos["reward_mine"].tolist() == [0.0, -0.25 * 0.01]
    assert (asked[0], asked[-1]) == (2, 1)


@pytest.mark.parametrize(
    ("function", "says"),
    [
        (lambda state: 1.0, r"mine gives numbers of shape \(\); wanted \(2,\), one for each robot"),
        (lambda state: np.array(state.joint_velocity), r"of shape \(12, 2\); wanted \(2,\)"),
        (lambda state: state.height * np.array([1.0, np.nan]), "mine gives nan; wanted finite numbers"),
        (lambda state, foot: foot.height, "mine fails: TypeError: .* missing 1 required positional argument: 'foot'"),
        (lambda state: ["high", "low"], "mine fails: ValueError: "),
    ],
)
def test_one_that_gives_no_reward_says_why(function: Callable[[Any], Any], says: str) -> None:
    env = SimpleQuadVectorEnv(2, nthread=1, config=task(function))
    env.reset(seed=0)
    with pytest.raises(RewardTermError, match=says):
        env.step(np.array([HOME, HOME]))
