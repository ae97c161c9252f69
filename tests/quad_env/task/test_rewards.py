"""Reward terms: values and signs worked out by hand."""

import math

import numpy as np
import pytest

from quad_env.columns import of_robots
from quad_env.config import RewardWeights
from quad_env.physics.state import QuadState
from quad_env.task.rewards import linear_velocity_error, reward_terms, step_weights, yaw_rate_error

ROLL = math.radians(30.0)
STATE = QuadState(
    position=(0.0, 0.0, 0.5),
    height=0.5,
    rotation=((1.0, 0.0, 0.0), (0.0, math.cos(ROLL), -math.sin(ROLL)), (0.0, math.sin(ROLL), math.cos(ROLL))),
    linear_velocity=(9.0, 9.0, 9.0),  # no term reads the base frame's
    angular_velocity=(0.4, -0.3, 9.0),
    heading_velocity=(0.6, -0.1, 0.2),
    vertical_velocity=-0.3,
    joint_position=(0.0,) * 12,
    joint_velocity=(0.0,) * 12,
    joint_torque=(3.0, -4.0, *(0.0,) * 10),
    trunk_contact=False,
    command=(1.0, 0.2, 0.45),
    action=(0.1, -0.1, 0.1, *(0.0,) * 9),
    previous_action=(0.0, 0.0, 0.0, 0.2, *(0.0,) * 8),
)
BY_HAND = {
    "linear_velocity_tracking": 1.2 * math.exp(-2.0),  # an error of (0.4, 0.3): 0.5 m/s, two widths
    "yaw_rate_tracking": 0.8 * math.exp(-1.0),  # 0.25 rad/s, one width
    "linear_velocity_error": 0.0,  # of no weight by default
    "yaw_rate_error": 0.0,
    "vertical_velocity": -0.5 * 0.09,
    "roll_pitch_rate": -0.02 * 0.25,
    "tilt": -0.5 * 0.25,  # sin² 30°
    "action_rate": -0.02 * (3 * 0.01 + 0.04),
    "torque": -2e-5 * 25.0,
}
"""Weighted rates, 1/s."""


@pytest.mark.parametrize("term", BY_HAND)
def test_a_term_is_its_rate_by_hand_times_the_control_period(term: str) -> None:
    found = reward_terms(STATE, False, False, step_weights(RewardWeights(), 0.01))
    assert found[f"reward_{term}"] == pytest.approx(0.01 * BY_HAND[term], rel=1e-12)
    assert (found[f"reward_{term}"] > 0) == term.endswith("tracking")


def test_errors_are_by_hand_what_they_are_of_no_weight() -> None:
    assert linear_velocity_error(STATE) == pytest.approx(0.5)  # (0.4, 0.3)
    assert yaw_rate_error(STATE) == pytest.approx(0.25)


def test_every_term_but_the_fall_is_worked_out_here() -> None:
    assert set(BY_HAND) == set(vars(RewardWeights())) - {"fall"}


@pytest.mark.parametrize("dt", [0.01, 0.02])
def test_a_fall_costs_one_whatever_the_control_period(dt: float) -> None:
    weights = step_weights(RewardWeights(), dt)
    assert reward_terms(STATE, True, False, weights)["reward_fall"] == -1.0
    assert reward_terms(STATE, False, False, weights)["reward_fall"] == 0.0


def test_a_diverged_robot_is_paid_for_its_end_alone() -> None:
    found = reward_terms(STATE, True, True, step_weights(RewardWeights(), 0.01))
    assert found.pop("reward_fall") == -1.0
    assert not any(found.values())


@pytest.mark.parametrize("term", ["linear_velocity_tracking", "yaw_rate_tracking"])
def test_tracking_pays_most_at_the_command_and_less_on_either_side(term: str) -> None:
    weights = step_weights(RewardWeights(), 0.01)

    def paid(forward: float, yaw_rate: float) -> float:
        state = STATE._replace(command=(0.5, 0.0, 0.3), heading_velocity=(forward, 0.0, yaw_rate))
        return reward_terms(state, False, False, weights)[f"reward_{term}"]

    assert paid(0.5, 0.3) > paid(0.4, 0.2) > paid(0.2, 0.0) > 0
    assert paid(0.5, 0.3) > paid(0.6, 0.4) > paid(0.8, 0.6) > 0


def test_n_robots_are_paid_as_each_alone_to_the_bit() -> None:
    rows = {name: np.array([value, value]) for name, value in STATE._asdict().items() if name != "rotation"}
    columns = {name: of_robots(array) if array.ndim == 2 else array for name, array in rows.items()}
    rotation = tuple(of_robots(np.array([row, row])) for row in STATE.rotation)
    weights = step_weights(RewardWeights(), 0.01)
    alone = reward_terms(STATE, True, False, weights)
    both = reward_terms(
        QuadState(rotation=rotation, **columns), np.array([True, False]), np.array([False, False]), weights
    )
    for name, value in alone.items():
        assert both[name][0] == value
