"""Reward terms: pure functions of the state; the weights are in `config.RewardWeights`.

A term is written once for one robot and for n, see `columns`. The tracking kernels follow the exponential form usual in
the field, with the error itself rather than its square in the exponent, so that the last centimetres per second still
pay.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, cast

import numpy as np

from quad_env.columns import (
    BoolOrMask,
    ScalarOrBatch,
    any_true,
    differences,
    exp,
    ordered_sum,
    sqrt,
    sum_of_squares,
    where,
)
from quad_env.config import RewardWeights
from quad_env.extensions import check_new
from quad_env.physics.state import QuadState

LINEAR_WIDTH = 0.25
"""m/s at which the linear tracking reward falls to 1/e."""
YAW_WIDTH = 0.25
"""rad/s at which the yaw tracking reward falls to 1/e."""
AIR_TIME = 0.15
"""Length of a swing that neither pays nor costs, s: about that of the trot's."""
UPRIGHT = 0.85
"""Height of the trunk, as a share of that in the home pose, from which on a robot does not crouch."""
MOVING = 0.1
"""Norm of a command (m/s, m/s, rad/s) up to which it asks to stand."""


def linear_velocity_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """exp(-‖e‖/LINEAR_WIDTH) of the planar velocity error in the heading frame."""
    return exp(-linear_velocity_error(state) / LINEAR_WIDTH)


def yaw_rate_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """exp(-‖e‖/YAW_WIDTH) of the yaw-rate error about the world's vertical."""
    return exp(-yaw_rate_error(state) / YAW_WIDTH)


def linear_velocity_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Planar velocity error in the heading frame, m/s: a slope where the tracking reward is flat, far off."""
    forward = state.command[0] - state.heading_velocity[0]
    lateral = state.command[1] - state.heading_velocity[1]
    return sqrt(forward * forward + lateral * lateral)


def yaw_rate_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Yaw-rate error about the world's vertical, rad/s."""
    return abs(state.command[2] - state.heading_velocity[2])


def vertical_velocity(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Square of the trunk's vertical velocity, (m/s)²."""
    return state.vertical_velocity * state.vertical_velocity


def roll_pitch_rate(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Square of the trunk's roll and pitch rates, (rad/s)²."""
    roll, pitch, _ = state.angular_velocity
    return roll * roll + pitch * pitch


def tilt(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Square of the sine of the tilt."""
    x, y, _ = state.projected_gravity
    return x * x + y * y


def crouch(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Height of the trunk below UPRIGHT, as a share of that in the home pose; 0 above it."""
    missing = UPRIGHT - state.height / state.standing_height
    return cast("ScalarOrBatch", where(missing > 0.0, missing, 0.0))


def action_rate(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Squared change of the joint targets since the last step, summed over joints, rad²."""
    return sum_of_squares(differences(state.action, state.previous_action))


def torque(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Squared joint torques, summed over joints, (N·m)²."""
    return sum_of_squares(state.joint_torque)


def mechanical_power(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Σ ‖torque · joint speed‖ over the joints, W."""
    return state.mechanical_power


def foot_air_time(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Σ (swing time - AIR_TIME) over the feet that touch down in this step, s; 0 where the command is to stand, and
    where swings are not looked at, since the term has no weight.

    As in legged_gym (Rudin et al. 2022, `_reward_feet_air_time`) and Isaac Lab (`feet_air_time`), to which a command to
    turn on the spot is one to stand.
    """
    if state.swing_time is None:
        return 0.0 * abs(state.height)
    swings: ScalarOrBatch = ordered_sum(where(swing > 0.0, swing - AIR_TIME, 0.0) for swing in state.swing_time)
    return cast("ScalarOrBatch", where(sum_of_squares(state.command) > MOVING * MOVING, swings, 0.0))


def touchdown_speed(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Σ of the squared downward speeds of the feet that touch down in this step, (m/s)²; 0 where they are not looked
    at, since the term has no weight."""
    return 0.0 * abs(state.height) if state.touchdown_speed is None else sum_of_squares(state.touchdown_speed)


RewardFunction = Callable[[QuadState[Any]], Any]
"""Unweighted reward term of a state: a float of one robot, an array (n,) of n robots."""
REWARD = "reward_"
"""Prefix of the key of every term in the infos."""
FUNCTIONS: tuple[RewardFunction, ...] = (
    linear_velocity_tracking,
    yaw_rate_tracking,
    linear_velocity_error,
    yaw_rate_error,
    vertical_velocity,
    roll_pitch_rate,
    tilt,
    crouch,
    action_rate,
    torque,
    mechanical_power,
    foot_air_time,
    touchdown_speed,
)
"""Functions of the terms that `RewardWeights` weighs, by their names."""
_FUNCTION_OF: dict[str, RewardFunction] = {function.__name__: function for function in FUNCTIONS}
TERMS: dict[str, RewardFunction] = {
    f"{REWARD}{term.name}": _FUNCTION_OF[term.name] for term in fields(RewardWeights) if term.name != "fall"
}
"""Key of each term in the infos -> its function of the state."""
FALL = f"{REWARD}fall"


def step_weights(weights: RewardWeights, dt: float) -> dict[str, float]:
    """Key of each term in the infos -> its weight in one step, in the order of `reward_terms`.

    Terms that accrue with time are multiplied by the control period, so that their sum over a second is their rate;
    `fall` counts once.
    """
    rates = {f"{REWARD}{name}": weight for name, weight in asdict(weights).items()}
    fall = rates.pop(FALL)
    return {key: weight * dt for key, weight in rates.items()} | {FALL: fall}


def reward_terms(
    state: QuadState[ScalarOrBatch], ended: BoolOrMask, diverged: BoolOrMask, weights: dict[str, float]
) -> dict[str, ScalarOrBatch]:
    """Weighted terms by `step_weights`, which add up to the reward; a diverged robot's only one is that of the fall."""
    terms = {key: weights[key] * term(state) for key, term in TERMS.items()}
    if any_true(diverged):
        terms = {key: where(diverged, 0.0, value) for key, value in terms.items()}
    terms[FALL] = weights[FALL] * where(ended, 1.0, 0.0)
    return terms


@dataclass(frozen=True)
class UserReward:
    """A reward term of a user, from the option `rewards` of an environment."""

    name: str
    function: RewardFunction
    weight: float
    """Reward a second and unit of the function."""

    def weighted(self, state: QuadState[ScalarOrBatch], diverged: BoolOrMask, dt: float) -> ScalarOrBatch:
        """Return the weighted term of a step; 0 of a diverged robot.

        Args:
            state: State after the step.
            diverged: True of robots without a finite state.
            dt: Control period, s.

        Returns:
            The term, a float of one robot or an array (n,) of n robots.

        Raises:
            ValueError: The function returned another shape, or a value that is not finite.
        """
        value = self.function(state)
        if np.shape(value) != np.shape(state.height):
            expected = "a number" if np.shape(state.height) == () else f"the shape {np.shape(state.height)}"
            raise ValueError(f"reward {self.name}: expected {expected}, got {value!r}")
        if not np.isfinite(value).all():
            raise ValueError(f"reward {self.name}: a value is not finite")
        return cast("ScalarOrBatch", where(diverged, 0.0, (self.weight * dt) * value))


def user_rewards(rewards: Mapping[str, Any] | None) -> dict[str, UserReward]:
    """Return the terms of the option `rewards` of an environment by their keys in the infos.

    Args:
        rewards: Name -> (function, weight), or name -> weight of a term that an extension has.

    Raises:
        ValueError: An unknown or built-in name, or a value of another kind.
    """
    builtin = {term.name: None for term in fields(RewardWeights)}
    terms: dict[str, UserReward] = {}
    for name, given in (rewards or {}).items():
        if name in builtin:
            raise ValueError(f"rewards: {name} exists already; its weight is config.reward_weights.{name}")
        if not (isinstance(name, str) and name.isidentifier()):
            raise ValueError(f"rewards: name {name!r} is not a Python identifier")
        function, weight = given if isinstance(given, tuple) else (_extension_reward(name, builtin), given)
        if not callable(function):
            raise ValueError(f"rewards: {name}: expected (function, weight), got {given!r}")
        if isinstance(weight, bool) or not isinstance(weight, int | float) or not np.isfinite(weight):
            raise ValueError(f"rewards: {name}: weight is a finite number, got {weight!r}")
        terms[f"{REWARD}{name}"] = UserReward(name, function, float(weight))
    return terms


def _extension_reward(name: str, builtin: dict[str, Any]) -> RewardFunction:
    known = check_new("rewards", builtin)
    if name not in known:
        valid = ", ".join(known) or "none is installed"
        raise ValueError(f"rewards: unknown term {name!r}; valid: {valid}, or a pair (function, weight)")
    function: RewardFunction = known[name]
    return function
