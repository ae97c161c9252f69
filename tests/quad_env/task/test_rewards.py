"""Reward terms: values and signs computed by hand."""

import math
from typing import Any

import numpy as np
import pytest

from quad_env.config import RewardWeights
from quad_env.physics.state import QuadState
from quad_env.task.rewards import (
    OPTIONAL_TERMS,
    crouch,
    foot_clearance,
    foot_slip,
    gait,
    joint_limits,
    linear_velocity_error,
    pose,
    reward_terms,
    stand_still,
    step_weights,
    yaw_rate_error,
)

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
    foot_contact=(False, True, True, False),
    foot_height=(0.16, 0.0, 0.0, 0.08),
    foot_speed=(0.5, 0.1, 0.0, 0.2),
    leg_phase=(math.pi / 2, 3 * math.pi / 2, math.pi, math.pi / 6),
    home_pose=(0.1, -0.2, 0.4, *(0.0,) * 9),
    joint_lower=(-1.0, 0.1, *(-1.0,) * 10),
    joint_upper=(1.0, 1.1, *(1.0,) * 10),
)
"""The trunk is 0.8 m high in the home pose, so the feet are 0.16 m high at mid-swing."""
WEIGHTS = RewardWeights(
    crouch=-2.0,
    mechanical_power=-0.01,
    foot_air_time=2.0,
    touchdown_speed=-3.0,
    gait=4.0,
    pose=0.5,
    stand_still=-0.7,
    joint_limits=-6.0,
    foot_slip=-0.2,
    foot_clearance=-9.0,
)
AGREEMENT = (
    1.0  # sin 90°: swings, at full height
    + math.exp(-0.01 / 0.05)  # sin 270°: stands, slips at 0.1 m/s
    + 0.5 * 1.0  # sin 180°: half of the weight is on standing, and half on a swing that is not there
    + 1.0  # sin 30°: swings, at half the height
)
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
    "gait": 4.0 * AGREEMENT / 4.0,
    "pose": 0.5 * math.exp(-(0.01 + 0.04 + 0.1 * 0.16)),
    "stand_still": 0.0,  # the command is to move
    "joint_limits": -6.0 * (0.6 - 0.95 * 0.5),  # joint 1 is at 0, 0.6 below the middle of its range
    "foot_slip": -0.2 * 0.01,  # the second foot is the only one in contact
    "foot_clearance": -9.0 * (0.16**2 * 0.1 + 0.08**2 * 0.2),
}
"""1/s. Weighted rates."""


@pytest.mark.parametrize("term", BY_HAND)
def test_a_term_is_its_rate_by_hand_times_the_control_period(term: str) -> None:
    found = reward_terms(STATE, False, False, step_weights(WEIGHTS, 0.01))
    assert found[f"reward_{term}"] == pytest.approx(0.01 * BY_HAND[term], rel=1e-12)
    assert (found[f"reward_{term}"] > 0) == term.endswith(("tracking", "air_time", "gait", "pose"))


def test_errors_are_by_hand_what_they_are_of_no_weight() -> None:
    assert linear_velocity_error(STATE) == pytest.approx(0.5)  # (0.4, 0.3)
    assert yaw_rate_error(STATE) == pytest.approx(0.25)


def test_every_term_but_the_fall_is_worked_out_here() -> None:
    assert set(BY_HAND) == set(vars(RewardWeights())) - {"fall"}


def test_optional_terms_of_no_weight_are_not_in_the_infos() -> None:
    found = reward_terms(STATE, False, False, step_weights(RewardWeights(), 0.01))
    assert {key.removeprefix("reward_") for key in found} == set(BY_HAND) - set(OPTIONAL_TERMS) | {"fall"}


def test_a_swing_pays_less_the_lower_it_is_than_the_clock_asks_and_nothing_on_the_ground() -> None:
    """At a sine of 1 a foot at half of the height is 0.5 too low: exp(-(0.5 / 0.6)²); above 1.25 it is too high."""

    def agreement(contact: bool, height: float) -> float:
        feet = {"foot_contact": (contact,) * 4, "foot_height": (0.16 * height,) * 4, "leg_phase": (math.pi / 2,) * 4}
        return float(gait(STATE._replace(**feet)))

    assert agreement(False, 1.0) == agreement(False, 1.25) == pytest.approx(1.0)
    assert agreement(False, 0.5) == pytest.approx(math.exp(-((0.5 / 0.6) ** 2)))
    assert agreement(False, 1.5) == pytest.approx(math.exp(-((0.25 / 0.6) ** 2)))
    assert agreement(True, 1.0) == 0.0


def test_all_feet_have_to_stand_and_joints_to_be_at_home_where_the_command_is_zero() -> None:
    still = STATE._replace(command=(0.0, 0.0, 0.0), foot_contact=(True, True, True, False))
    assert gait(still) == pytest.approx((math.exp(-0.25 / 0.05) + math.exp(-0.01 / 0.05) + 1.0 + 0.0) / 4.0)
    assert stand_still(still) == pytest.approx(0.1 + 0.2 + 0.4)


def test_terms_of_a_batch_are_those_of_its_robots() -> None:
    robots = [STATE, STATE._replace(command=(0.0, 0.0, 0.0), joint_position=(0.3,) * 12, foot_contact=(True,) * 4)]
    constants = ("home_pose", "joint_lower", "joint_upper")
    batch: QuadState[Any] = STATE._replace(
        **{
            name: np.stack([np.asarray(getattr(robot, name)) for robot in robots], axis=-1)
            for name in STATE._fields
            if name not in constants
        }
    )
    for term in (gait, pose, stand_still, joint_limits, foot_slip, foot_clearance):
        np.testing.assert_allclose(term(batch), [term(robot) for robot in robots], rtol=1e-12)


def test_without_a_clock_or_feet_their_terms_are_zero() -> None:
    assert gait(STATE._replace(leg_phase=None)) == 0.0
    blind = STATE._replace(foot_contact=None, foot_height=None, foot_speed=None)
    assert gait(blind) == foot_slip(blind) == foot_clearance(blind) == 0.0


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
