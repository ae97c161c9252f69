"""Reward terms: pure functions of the state; the weights are in `config.RewardWeights`.

A term is written once for one robot and for n, see `columns`. The tracking kernels follow the exponential form usual in
the field, with the error itself rather than its square in the exponent, so that the last centimetres per second still
pay.
"""

from dataclasses import asdict
from typing import Protocol

from quad_env.columns import Column, Truth, anywhere, differences, exp, sqrt, sum_of_squares, where
from quad_env.config import RewardWeights
from quad_env.physics.state import QuadState

LINEAR_WIDTH = 0.25
"""m/s at which the linear tracking reward falls to 1/e."""
YAW_WIDTH = 0.25
"""rad/s at which the yaw tracking reward falls to 1/e."""


def linear_velocity_tracking(state: QuadState[Column]) -> Column:
    """exp(-‖e‖/LINEAR_WIDTH) of the planar velocity error in the heading frame."""
    return exp(-linear_velocity_error(state) / LINEAR_WIDTH)


def yaw_rate_tracking(state: QuadState[Column]) -> Column:
    """exp(-|e|/YAW_WIDTH) of the yaw-rate error about the world's vertical."""
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


class Term(Protocol):
    """A reward term."""

    __name__: str

    def __call__(self, state: QuadState[Column]) -> Column:
        """The term's value, not weighted."""


_FUNCTIONS: tuple[Term, ...] = (
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
TERMS = {f"reward_{function.__name__}": function for function in _FUNCTIONS}
"""Key of each term in the infos -> its function."""
FALL = "reward_fall"


def step_weights(weights: RewardWeights, dt: float) -> dict[str, float]:
    """Key of each term in the infos -> its weight in one step.

    Terms that accrue with time are multiplied by the control period, so that their sum over a second is their rate;
    `fall` is paid once.
    """
    rates = {f"reward_{name}": weight for name, weight in asdict(weights).items()}
    return {key: weight if key == FALL else weight * dt for key, weight in rates.items()}


def reward_terms(
    state: QuadState[Column], ended: Truth, diverged: Truth, weights: dict[str, float]
) -> dict[str, Column]:
    """Weighted terms by `step_weights`, which add up to the reward; a diverged robot's only one is that of the fall."""
    terms = {key: weights[key] * term(state) for key, term in TERMS.items()}
    if anywhere(diverged):
        terms = {key: where(diverged, 0.0, value) for key, value in terms.items()}
    terms[FALL] = weights[FALL] * where(ended, 1.0, 0.0)
    return terms
