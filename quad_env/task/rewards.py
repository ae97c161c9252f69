"""Reward terms: pure functions of the state; the weights are in `config.RewardWeights`.

Every term works on one robot and on n, see `columns`. The tracking terms have the field's exponential form, with the
error itself instead of its square in the exponent, so that small errors still have a gradient.
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

LINEAR_ERROR_SCALE = 0.25
"""m/s. Velocity error at which the linear tracking reward is 1/e."""
YAW_ERROR_SCALE = 0.25
"""rad/s. Yaw-rate error at which the yaw tracking reward is 1/e."""
NEUTRAL_SWING_TIME = 0.15
"""s. Swing time with a reward of 0, about the trot's; longer swings are rewarded, shorter ones penalised."""
MIN_HEIGHT_FRACTION = 0.85
"""Trunk height, as a fraction of its height in the home pose, below which a robot crouches."""
MAX_STAND_COMMAND = 0.1
"""Norm of a command (m/s, m/s, rad/s) up to which it is a command to stand."""


def linear_velocity_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-‖e‖ / LINEAR_ERROR_SCALE) of the planar velocity error e in the heading frame."""
    return exp(-linear_velocity_error(state) / LINEAR_ERROR_SCALE)


def yaw_rate_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-|e| / YAW_ERROR_SCALE) of the yaw-rate error e about the world's vertical."""
    return exp(-yaw_rate_error(state) / YAW_ERROR_SCALE)


def linear_velocity_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the planar velocity error in the heading frame, m/s: a gradient where the tracking reward is flat."""
    forward = state.command[0] - state.heading_velocity[0]
    lateral = state.command[1] - state.heading_velocity[1]
    return sqrt(forward * forward + lateral * lateral)


def yaw_rate_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the yaw-rate error about the world's vertical, rad/s."""
    return abs(state.command[2] - state.heading_velocity[2])


def vertical_velocity(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the squared vertical velocity of the trunk, (m/s)²."""
    return state.vertical_velocity * state.vertical_velocity


def roll_pitch_rate(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of the squared roll and pitch rates of the trunk, (rad/s)²."""
    roll, pitch, _ = state.angular_velocity
    return roll * roll + pitch * pitch


def tilt(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the squared sine of the tilt."""
    x, y, _ = state.projected_gravity
    return x * x + y * y


def crouch(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the drop of the trunk below MIN_HEIGHT_FRACTION, as a fraction of its home height; 0 above it."""
    shortfall = MIN_HEIGHT_FRACTION - state.height / state.standing_height
    return cast("ScalarOrBatch", where(shortfall > 0.0, shortfall, 0.0))


def action_rate(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the squared change of the joint targets since the last step, summed over joints, rad²."""
    return sum_of_squares(differences(state.action, state.previous_action))


def torque(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the squared joint torques, summed over joints, (N·m)²."""
    return sum_of_squares(state.joint_torque)


def mechanical_power(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ |torque · joint speed| over the joints, W."""
    return state.mechanical_power


def foot_air_time(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (swing time - NEUTRAL_SWING_TIME) over the feet that touch down in this step, s.

    It is 0 for a command to stand, and if swings are not tracked because no term needs them. See legged_gym (Rudin et
    al. 2022, `_reward_feet_air_time`) and Isaac Lab (`feet_air_time`); there, a command to turn on the spot is also a
    command to stand.
    """
    if state.swing_time is None:
        return 0.0 * abs(state.height)
    swings: ScalarOrBatch = ordered_sum(
        where(swing > 0.0, swing - NEUTRAL_SWING_TIME, 0.0) for swing in state.swing_time
    )
    return cast(
        "ScalarOrBatch", where(sum_of_squares(state.command) > MAX_STAND_COMMAND * MAX_STAND_COMMAND, swings, 0.0)
    )


def touchdown_speed(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (touchdown speed)² over the feet that touch down in this step, (m/s)².

    It is 0 if touchdowns are not tracked because no term needs them.
    """
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
"""Key of the fall's term in the infos."""


def step_weights(weights: RewardWeights, dt: float) -> dict[str, float]:
    """Return the weight of each term in one step.

    Terms that accrue with time are multiplied by the control period, so that their sum over a second is their rate;
    `fall` counts once.

    Args:
        weights: Weights of the terms.
        dt: Control period, s.

    Returns:
        Key of each term in the infos -> weight, in the order of `reward_terms`.
    """
    rates = {f"{REWARD}{name}": weight for name, weight in asdict(weights).items()}
    fall = rates.pop(FALL)
    return {key: weight * dt for key, weight in rates.items()} | {FALL: fall}


def reward_terms(
    state: QuadState[ScalarOrBatch], terminated: BoolOrMask, diverged: BoolOrMask, weights: dict[str, float]
) -> dict[str, ScalarOrBatch]:
    """Return the weighted terms, which add up to the reward.

    Args:
        state: State after the step.
        terminated: True for robots with an episode that ends in this step.
        diverged: True for robots without a finite state; all their terms but the fall's are 0.
        weights: Weights of one step, see `step_weights`.

    Returns:
        Key of each term in the infos -> value.
    """
    terms = {key: weights[key] * term(state) for key, term in TERMS.items()}
    if any_true(diverged):
        terms = {key: where(diverged, 0.0, value) for key, value in terms.items()}
    terms[FALL] = weights[FALL] * where(terminated, 1.0, 0.0)
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
    """Return the terms of the option `rewards` of an environment.

    Args:
        rewards: Name -> (function, weight), or name -> weight of a term that an extension has.

    Returns:
        Key of each term in the infos -> term.

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
    """Return the function of an extension's reward term; raise ValueError for an unknown or built-in name."""
    known = check_new("rewards", builtin)
    if name not in known:
        valid = ", ".join(known) or "none is installed"
        raise ValueError(f"rewards: unknown term {name!r}; valid: {valid}, or a pair (function, weight)")
    function: RewardFunction = known[name]
    return function
