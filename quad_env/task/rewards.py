"""Reward terms: pure functions of the state; the weights are in `config.RewardWeights`.

Every term works for one robot and for n robots, see `columns`. The tracking terms have the usual exponential form, but
the exponent has the error instead of the squared error, so that small errors still give a gradient.
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
"""Velocity error at which the linear tracking reward is 1/e, m/s."""
YAW_ERROR_SCALE = 0.25
"""Yaw-rate error at which the yaw tracking reward is 1/e, rad/s."""
NEUTRAL_SWING_TIME = 0.15
"""Swing time with zero reward, about a trot's, s. Longer swings are rewarded, shorter ones penalised."""
MIN_HEIGHT_FRACTION = 0.85
"""Trunk height below which the robot crouches, as a fraction of the trunk height in the home pose."""
MAX_STAND_COMMAND = 0.1
"""Largest norm of a command, (m/s, m/s, rad/s), that counts as a command to stand."""


def linear_velocity_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-‖e‖ / LINEAR_ERROR_SCALE) of the planar velocity error e in the heading frame."""
    return exp(-linear_velocity_error(state) / LINEAR_ERROR_SCALE)


def yaw_rate_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-‖e‖ / YAW_ERROR_SCALE) of the yaw-rate error e about the world's vertical."""
    return exp(-yaw_rate_error(state) / YAW_ERROR_SCALE)


def linear_velocity_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the magnitude of the planar velocity error in the heading frame, m/s.

    Unlike the tracking reward, this term has a gradient at large errors too.
    """
    forward = state.command[0] - state.heading_velocity[0]
    lateral = state.command[1] - state.heading_velocity[1]
    return sqrt(forward * forward + lateral * lateral)


def yaw_rate_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the magnitude of the yaw-rate error about the world's vertical, rad/s."""
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
    """Return the depth of the trunk below MIN_HEIGHT_FRACTION of the home height; 0 if it is higher.

    The depth is a fraction of the home height, which is the trunk height in the home pose.
    """
    shortfall = MIN_HEIGHT_FRACTION - state.height / state.standing_height
    return cast("ScalarOrBatch", where(shortfall > 0.0, shortfall, 0.0))


def action_rate(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the squared change of the joint targets since the last step, summed over joints, rad²."""
    return sum_of_squares(differences(state.action, state.previous_action))


def torque(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the squared joint torques, summed over joints, (N·m)²."""
    return sum_of_squares(state.joint_torque)


def mechanical_power(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the mechanical power Σ ‖torque · joint speed‖ over the joints, W."""
    return state.mechanical_power


def foot_air_time(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (swing time - NEUTRAL_SWING_TIME) over the feet that touch down in this step, s.

    The term is 0 for a command to stand. It is also 0 if the simulation does not track swings, because no weighted term
    needs them. See legged_gym (Rudin et al. 2022, `_reward_feet_air_time`) and Isaac Lab (`feet_air_time`); in both, a
    command to turn on the spot is also a command to stand.
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

    The term is 0 if the simulation does not track touchdowns, because no weighted term needs them.
    """
    return 0.0 * abs(state.height) if state.touchdown_speed is None else sum_of_squares(state.touchdown_speed)


RewardFunction = Callable[[QuadState[Any]], Any]
"""Function of a `QuadState` that returns an unweighted reward term: a float for one robot, or an array (n,)."""
REWARD = "reward_"
"""Prefix of the key of every reward term in the infos."""
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
"""Functions of the built-in reward terms; each has the name of a field of `RewardWeights`."""
_FUNCTION_OF: dict[str, RewardFunction] = {function.__name__: function for function in FUNCTIONS}
TERMS: dict[str, RewardFunction] = {
    f"{REWARD}{term.name}": _FUNCTION_OF[term.name] for term in fields(RewardWeights) if term.name != "fall"
}
"""Key of each term in the infos -> function of the state; the term `fall` is not a function of the state."""
FALL = f"{REWARD}fall"
"""Key of the term `fall` in the infos."""


def step_weights(weights: RewardWeights, dt: float) -> dict[str, float]:
    """Return the factor on each reward term in one control step.

    All weights but the weight of `fall` are rewards per second, so they are multiplied by the control period. The
    weight of `fall` counts once.

    Args:
        weights: Weights of the terms.
        dt: Control period, s.

    Returns:
        Key of each term in the infos -> factor, in the order of `reward_terms`.
    """
    rates = {f"{REWARD}{name}": weight for name, weight in asdict(weights).items()}
    fall = rates.pop(FALL)
    return {key: weight * dt for key, weight in rates.items()} | {FALL: fall}


def reward_terms(
    state: QuadState[ScalarOrBatch], terminated: BoolOrMask, diverged: BoolOrMask, weights: dict[str, float]
) -> dict[str, ScalarOrBatch]:
    """Compute the weighted built-in reward terms of a control step.

    Args:
        state: State after the step.
        terminated: True for robots with an episode that ends in this step.
        diverged: True for robots with a diverged simulation; all their terms but `fall` are 0.
        weights: Factors from `step_weights`.

    Returns:
        Key of each term in the infos -> weighted value.
    """
    terms = {key: weights[key] * term(state) for key, term in TERMS.items()}
    if any_true(diverged):
        terms = {key: where(diverged, 0.0, value) for key, value in terms.items()}
    terms[FALL] = weights[FALL] * where(terminated, 1.0, 0.0)
    return terms


@dataclass(frozen=True)
class UserReward:
    """Reward term of a user, from the argument `rewards` of an environment."""

    name: str
    function: RewardFunction
    weight: float
    """Reward per second and per unit of the value of `function`."""

    def weighted(self, state: QuadState[ScalarOrBatch], diverged: BoolOrMask, dt: float) -> ScalarOrBatch:
        """Compute the weighted term of a control step; it is 0 for robots with a diverged simulation.

        Args:
            state: State after the step.
            diverged: True for robots with a diverged simulation.
            dt: Control period, s.

        Returns:
            The weighted term, a float for one robot or an array (n,) for n robots.

        Raises:
            ValueError: `function` returned a wrong shape, or a value that is not finite.
        """
        value = self.function(state)
        if np.shape(value) != np.shape(state.height):
            expected = "a number" if np.shape(state.height) == () else f"the shape {np.shape(state.height)}"
            raise ValueError(f"reward {self.name}: expected {expected}, got {value!r}")
        if not np.isfinite(value).all():
            raise ValueError(f"reward {self.name}: a value is not finite")
        return cast("ScalarOrBatch", where(diverged, 0.0, (self.weight * dt) * value))


def user_rewards(rewards: Mapping[str, Any] | None) -> dict[str, UserReward]:
    """Return the user's reward terms from the argument `rewards` of an environment.

    Args:
        rewards: Name -> (function, weight), or name -> weight for a reward term of an extension.

    Returns:
        Key of each term in the infos -> term.

    Raises:
        ValueError: A name is unknown or built in, or a function or weight has a wrong type.
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
    """Return an extension's reward function; raise ValueError for an unknown or built-in name."""
    known = check_new("rewards", builtin)
    if name not in known:
        valid = ", ".join(known) or "none is installed"
        raise ValueError(f"rewards: unknown term {name!r}; valid: {valid}, or a pair (function, weight)")
    function: RewardFunction = known[name]
    return function
