"""Reward terms: pure functions of the state; the weights are in `config.RewardWeights`.

A term is written once for one robot and for n, see `columns`. The tracking kernels follow the exponential form usual in
the field, with the error itself rather than its square in the exponent, so that the last centimetres per second still
pay.
"""

from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any, cast

from quad_env.columns import Column, Truth, Vector, anywhere, differences, exp, sqrt, sum_of_squares, total, where
from quad_env.config import RewardWeights
from quad_env.physics.state import Feet, QuadState

LINEAR_WIDTH = 0.25
"""m/s at which the linear tracking reward falls to 1/e."""
YAW_WIDTH = 0.25
"""rad/s at which the yaw tracking reward falls to 1/e."""
AIR_TIME = 0.15
"""Length of a swing that neither pays nor costs, s: about that of the trot's."""
CLEARANCE = 0.08
"""Height that the lowest point of a swinging foot is to have above the ground, m: that of the trot at mid-swing."""
MOVING = 0.1
"""Norm of a command (m/s, m/s, rad/s) up to which it asks to stand."""


def linear_velocity_tracking(state: QuadState[Column]) -> Column:
    """exp(-‖e‖/LINEAR_WIDTH) of the planar velocity error in the heading frame."""
    return exp(-linear_velocity_error(state) / LINEAR_WIDTH)


def yaw_rate_tracking(state: QuadState[Column]) -> Column:
    """exp(-‖e‖/YAW_WIDTH) of the yaw-rate error about the world's vertical."""
    return exp(-yaw_rate_error(state) / YAW_WIDTH)


def linear_velocity_error(state: QuadState[Column]) -> Column:
    """Planar velocity error in the heading frame, m/s: a slope where the tracking reward is flat, far off."""
    forward = state.command[0] - state.heading_velocity[0]
    lateral = state.command[1] - state.heading_velocity[1]
    return sqrt(forward * forward + lateral * lateral)


def yaw_rate_error(state: QuadState[Column]) -> Column:
    """Yaw-rate error about the world's vertical, rad/s."""
    return abs(state.command[2] - state.heading_velocity[2])


def vertical_velocity(state: QuadState[Column]) -> Column:
    """Square of the trunk's vertical velocity, (m/s)²."""
    return state.vertical_velocity * state.vertical_velocity


def roll_pitch_rate(state: QuadState[Column]) -> Column:
    """Square of the trunk's roll and pitch rates, (rad/s)²."""
    roll, pitch, _ = state.angular_velocity
    return roll * roll + pitch * pitch


def tilt(state: QuadState[Column]) -> Column:
    """Square of the sine of the tilt."""
    x, y, _ = state.projected_gravity
    return x * x + y * y


def action_rate(state: QuadState[Column]) -> Column:
    """Squared change of the joint targets since the last step, summed over joints, rad²."""
    return sum_of_squares(differences(state.action, state.previous_action))


def torque(state: QuadState[Column]) -> Column:
    """Squared joint torques, summed over joints, (N·m)²."""
    return sum_of_squares(state.joint_torque)


def foot_air_time(state: QuadState[Column], feet: Feet[Column]) -> Column:
    """Σ (swing time - AIR_TIME) over the feet that touch down in this step, s; 0 where the command is to stand.

    As in legged_gym (Rudin et al. 2022, `_reward_feet_air_time`) and Isaac Lab (`feet_air_time`), to which a command to
    turn on the spot is one to stand.
    """
    swings: Column = total(where(swing > 0.0, swing - AIR_TIME, 0.0) for swing in feet.swing_time)
    return cast("Column", where(sum_of_squares(state.command) > MOVING * MOVING, swings, 0.0))


def foot_clearance(_: QuadState[Column], feet: Feet[Column]) -> Column:
    """Σ (height - CLEARANCE)² · horizontal speed over the feet in the air, m³/s: the form of DreamWaQ (Nahrendra et al.
    2023, table I), with heights above the ground below, and without the feet on the ground, which `foot_slip` has."""
    each = zip(feet.contact, feet.height, map(_horizontal_speed_squared, feet.velocity), strict=True)
    missed: Iterable[Column] = (
        where(contact, 0.0, (height - CLEARANCE) * (height - CLEARANCE) * sqrt(speed))
        for contact, height, speed in each
    )
    return total(missed)


def foot_slip(_: QuadState[Column], feet: Feet[Column]) -> Column:
    """Σ squared horizontal speed of the feet on the ground, (m/s)², as in MuJoCo Playground (`_cost_feet_slip`)."""
    speeds = map(_horizontal_speed_squared, feet.velocity)
    slips: Iterable[Column] = (where(touch, speed, 0.0) for touch, speed in zip(feet.contact, speeds, strict=True))
    return total(slips)


def foot_impact(_: QuadState[Column], feet: Feet[Column]) -> Column:
    """Σ squared impact speed of the feet that touch down in this step, (m/s)²: as in Walk These Ways (Margolis and
    Agrawal 2022, `_reward_feet_impact_vel`), the downward speed of the step before."""
    return sum_of_squares(feet.impact_speed)


def _horizontal_speed_squared(velocity: Vector[Column]) -> Column:
    return velocity[0] * velocity[0] + velocity[1] * velocity[1]


REWARD = "reward_"
"""Begins the key of every term in the infos."""
TERMS: dict[str, Callable[..., Any]] = {
    f"{REWARD}{function.__name__}": function
    for function in (
        linear_velocity_tracking,
        yaw_rate_tracking,
        linear_velocity_error,
        yaw_rate_error,
        vertical_velocity,
        roll_pitch_rate,
        tilt,
        action_rate,
        torque,
    )
}
"""Key of each term in the infos -> its function of the state."""
FOOT_TERMS: dict[str, Callable[..., Any]] = {
    f"{REWARD}{function.__name__}": function for function in (foot_air_time, foot_clearance, foot_slip, foot_impact)
}
"""The same of the terms of state and feet, which are worked out where they have a weight, and 0 elsewhere."""
FALL = f"{REWARD}fall"


def step_weights(weights: RewardWeights, dt: float) -> dict[str, float]:
    """Key of each term in the infos -> its weight in one step, in the order of `reward_terms`.

    Terms that accrue with time are multiplied by the control period, so that their sum over a second is their rate;
    `fall` counts once.
    """
    rates = {f"{REWARD}{name}": weight for name, weight in asdict(weights).items()}
    fall = rates.pop(FALL)
    return {key: weight * dt for key, weight in rates.items()} | {FALL: fall}


def look_at_feet(weights: dict[str, float]) -> bool:
    """Whether some term of `step_weights` asks for the feet."""
    return any(weights[key] for key in FOOT_TERMS)


def reward_terms(
    state: QuadState[Column], ended: Truth, diverged: Truth, weights: dict[str, float]
) -> dict[str, Column]:
    """Weighted terms by `step_weights`, which add up to the reward; a diverged robot's only one is that of the fall."""
    terms = {key: weights[key] * term(state) for key, term in TERMS.items()}
    for key, foot_term in FOOT_TERMS.items():
        terms[key] = weights[key] * foot_term(state, state.feet) if weights[key] else 0.0 * abs(state.height)
    if anywhere(diverged):
        terms = {key: where(diverged, 0.0, value) for key, value in terms.items()}
    terms[FALL] = weights[FALL] * where(ended, 1.0, 0.0)
    return terms
