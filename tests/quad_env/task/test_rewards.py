"""Reward terms: values and signs computed by hand."""

import math

import pytest

from quad_env.config import RewardWeights
from quad_env.physics.state import QuadState
from quad_env.task.rewards import crouch, linear_velocity_error, reward_terms, step_weights, yaw_rate_error

ROLL = math.radians(30.0)
STATE = QuadState(
    position=(0.0, 0.0, 0.5),
    height=0.5,
    standing_height=0.8,
    rotation=((1.0, 0.0, 0.0), (0.0, math.cos(ROLL), -math.sin(ROLL)), (0.0, math.sin(ROLL), math.cos(ROLL))),
    linear_velocity=(9.0, 9.0, 9.0),  # no term uses the base frame
    angular_velocity=(0.4, -0.3, 9.0),
    heading_velocity=(0.6, -0.1, 0.2),
    vertical_velocity=-0.3,
    joint_position=(0.0,) * 12,
    joint_velocity=(2.0, 0.5, *(0.0,) * 10),
    joint_torque=(3.0, -4.0, *(0.0,) * 10),
    trunk_contact=False,
    command=(1.0, 0.2, 0.45),
    action=(0.1, -0.1, 0.1, *(0.0,) * 9),
    previous_action=(0.0, 0.0, 0.0, 0.2, *(0.0,) * 8),
    swing_time=(0.25, 0.1, 0.0, 0.0),
    touchdown_speed=(0.3, 0.1, 0.0, 0.0),
)
WEIGHTS = RewardWeights(crouch=-2.0, mechanical_power=-0.01, foot_air_time=2.0, touchdown_speed=-3.0)
BY_HAND = {
    "linear_velocity_tracking": 1.2 * math.exp(-2.0),  # an error of (0.4, 0.3): 0.5 m/s, two widths
    "yaw_rate_tracking": 0.8 * math.exp(-1.0),  # 0.25 rad/s, one width
    "linear_velocity_error": 0.0,  # weight 0 by default
    "yaw_rate_error": 0.0,
    "vertical_velocity": -0.5 * 0.09,
    "roll_pitch_rate": -0.02 * 0.25,
    "tilt": -0.5 * 0.25,  # sin² 30°
    "crouch": -2.0 * (0.85 - 0.625),
    "action_rate": -0.02 * (3 * 0.01 + 0.04),
    "torque": -2e-5 * 25.0,
    "mechanical_power": -0.01 * (3.0 * 2.0 + 4.0 * 0.5),
    "foot_air_time": 2.0 * (0.10 - 0.05),  # relative to 0.15 s
    "touchdown_speed": -3.0 * (0.09 + 0.01),
}
"""1/s. Weighted rates."""


@pytest.mark.parametrize("term", BY_HAND)
def test_a_term_is_its_rate_by_hand_times_the_control_period(term: str) -> None:
    found = reward_terms(STATE, False, False, step_weights(WEIGHTS, 0.01))
    assert found[f"reward_{term}"] == pytest.approx(0.01 * BY_HAND[term], rel=1e-12)
    assert (found[f"reward_{term}"] > 0) == term.endswith(("tracking", "air_time"))


def test_errors_are_by_hand_what_they_are_of_no_weight() -> None:
    assert linear_velocity_error(STATE) == pytest.approx(0.5)  # (0.4, 0.3)
    assert yaw_rate_error(STATE) == pytest.approx(0.25)


def test_every_term_but_the_fall_is_worked_out_here() -> None:
    assert set(BY_HAND) == set(vars(RewardWeights())) - {"fall"}


def test_who_stands_tall_does_not_crouch() -> None:
    assert crouch(STATE._replace(height=0.681)) == 0.0
    assert crouch(STATE._replace(height=0.679)) == pytest.approx(0.85 - 0.679 / 0.8)


def test_swings_that_are_not_looked_at_pay_nothing() -> None:
    found = reward_terms(
        STATE._replace(swing_time=None, touchdown_speed=None), False, False, step_weights(RewardWeights(), 0.01)
    )
    assert found["reward_foot_air_time"] == found["reward_touchdown_speed"] == 0.0


@pytest.mark.parametrize(("command", "pays"), [((0.1, 0.0, 0.0), 0), ((0.0, 0.08, 0.07), 1), ((0.0, 0.0, -0.2), 1)])
def test_swings_pay_where_the_command_is_to_move(command: tuple[float, float, float], pays: int) -> None:
    found = reward_terms(STATE._replace(command=command), False, False, step_weights(WEIGHTS, 0.01))
    assert found["reward_foot_air_time"] == pytest.approx(pays * 0.01 * BY_HAND["foot_air_time"])


@pytest.mark.parametrize("dt", [0.01, 0.02])
def test_a_fall_costs_one_whatever_the_control_period(dt: float) -> None:
    weights = step_weights(RewardWeights(), dt)
    assert reward_terms(STATE, True, False, weights)["reward_fall"] == -1.0
    assert reward_terms(STATE, False, False, weights)["reward_fall"] == 0.0


def test_a_diverged_robot_is_paid_for_its_end_alone() -> None:
    found = reward_terms(STATE, True, True, step_weights(WEIGHTS, 0.01))
    assert found.pop("reward_fall") == -1.0
    assert not any(found.values())
