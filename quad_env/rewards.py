"""Reward terms: pure functions of the state, one value a robot; the weights are in `config.RewardWeights`.

The tracking kernels follow the exponential form usual in the field, with the error itself rather than its square in the
exponent, so that the last centimetres per second still pay.
"""

from collections.abc import Callable
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from quad_env.config import RewardWeights
from quad_env.state import QuadState

Array = NDArray[np.float64]
LINEAR_WIDTH = 0.25
"""m/s at which the linear tracking reward falls to 1/e."""
YAW_WIDTH = 0.25
"""rad/s at which the yaw tracking reward falls to 1/e."""


def linear_velocity_tracking(state: QuadState) -> Array:
    """exp(-‖e‖/LINEAR_WIDTH) of the planar velocity error in the heading frame."""
    forward = state.command[:, 0] - state.heading_velocity[:, 0]
    lateral = state.command[:, 1] - state.heading_velocity[:, 1]
    return np.exp(-np.sqrt(forward * forward + lateral * lateral) / LINEAR_WIDTH)


def yaw_rate_tracking(state: QuadState) -> Array:
    """exp(-|e|/YAW_WIDTH) of the yaw-rate error about the world's vertical."""
    return np.exp(-np.abs(state.command[:, 2] - state.heading_velocity[:, 2]) / YAW_WIDTH)


def vertical_velocity(state: QuadState) -> Array:
    """Square of the trunk's vertical velocity, (m/s)²."""
    return state.vertical_velocity**2


def roll_pitch_rate(state: QuadState) -> Array:
    """Square of the trunk's roll and pitch rates, (rad/s)²."""
    return state.angular_velocity[:, 0] ** 2 + state.angular_velocity[:, 1] ** 2


def tilt(state: QuadState) -> Array:
    """Square of the sine of the tilt."""
    return state.projected_gravity[:, 0] ** 2 + state.projected_gravity[:, 1] ** 2


def action_rate(state: QuadState) -> Array:
    """Squared change of the joint targets since the last step, summed over joints, rad²."""
    total: Array = np.square(state.action - state.previous_action).sum(axis=1)
    return total


def torque(state: QuadState) -> Array:
    """Squared joint torques, summed over joints, (N·m)²."""
    total: Array = np.square(state.joint_torque).sum(axis=1)
    return total


TERMS: dict[str, Callable[[QuadState], Array]] = {
    function.__name__: function
    for function in (
        linear_velocity_tracking,
        yaw_rate_tracking,
        vertical_velocity,
        roll_pitch_rate,
        tilt,
        action_rate,
        torque,
    )
}


def reward_terms(state: QuadState, fell: NDArray[np.bool_], weights: RewardWeights, dt: float) -> dict[str, Array]:
    """Weighted terms, name -> (n,).

    Terms that accrue with time are multiplied by the control period, so that their sum over a second is their rate;
    `fall` is paid once.
    """
    weight = asdict(weights)
    terms = {name: weight[name] * dt * term(state) for name, term in TERMS.items()}
    return terms | {"fall": weights.fall * fell.astype(np.float64)}
