"""Reward terms, which are pure functions of the state, and their weighted values in a control step.

The weights are in `config.RewardWeights`. Every term accepts a state of one robot (floats) or of n robots (arrays), see
`columns`. The tracking terms have the usual exponential form, but the exponent contains the error e instead of e²,
because the gradient of exp(-e) does not vanish at small errors.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, cast

import numpy as np

from quad_env.columns import (
    BoolOrMask,
    ScalarOrBatch,
    any_true,
    clip,
    differences,
    exp,
    ordered_sum,
    sin,
    sqrt,
    sum_of_squared_differences,
    sum_of_squares,
    where,
    zeros_by_key,
)
from quad_env.config import RewardWeights
from quad_env.extensions import check_new
from quad_env.physics.state import QuadState

LINEAR_ERROR_SCALE = 0.25
"""Error of the horizontal velocity at which the term `linear_velocity_tracking` is exp(-1), m/s."""
YAW_ERROR_SCALE = 0.25
"""Error of the yaw rate at which the reward term `yaw_rate_tracking` is exp(-1), rad/s."""
NEUTRAL_SWING_TIME = 0.15
"""Swing duration at which the reward term `foot_air_time` is 0, about the swing duration of a trot, s.

The term is positive for longer swings, and negative for shorter swings.
"""
MIN_HEIGHT_FRACTION = 0.85
"""Trunk height below which the reward term `crouch` is positive, as a fraction of the home height."""
MAX_STAND_COMMAND = 0.1
"""Largest norm of a velocity command with which the reward term `foot_air_time` is 0.

The norm is √(forward² + lateral² + yaw rate²), in m/s and rad/s.
"""
SWING_HEIGHT_FRACTION = 0.2
"""Desired height of the underside of a foot at mid-swing, as a fraction of the trunk's home height.

The terms `gait` and `foot_clearance` use this height. For the robot go1, the height is 0.06 m.
"""
MAX_SWING_HEIGHT_RATIO = 1.25
"""Height of a swing foot above which the reward term `gait` decreases, as a multiple of the mid-swing height."""
SWING_HEIGHT_WIDTH_RATIO = 0.6
"""Height error of a swing foot at which the term `gait` falls to 1/e, as a multiple of the mid-swing height."""
SLIP_SCALE = 0.05
"""Squared horizontal speed of a stance foot at which the reward term `gait` falls to 1/e, (m/s)²."""
POSE_WEIGHTS = (1.0, 1.0, 0.1)
"""Weights of the hip, thigh and calf joints of a leg in the reward term `pose`, 1/rad².

The weight of the calf is small, because a leg must bend its knee to swing.
"""
SOFT_LIMIT_FRACTION = 0.95
"""Fraction of a joint's range, around its centre, within which the reward term `joint_limits` is 0."""


def linear_velocity_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-‖e‖ / LINEAR_ERROR_SCALE) with the horizontal velocity error e, heading frame, (2), m/s.

    The error is the commanded velocity minus the velocity of the trunk.
    """
    return exp(-linear_velocity_error(state) / LINEAR_ERROR_SCALE)


def yaw_rate_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-e / YAW_ERROR_SCALE) with the absolute error e of the yaw rate about the world's vertical, rad/s.

    The error is the commanded yaw rate minus the yaw rate of the trunk.
    """
    return exp(-yaw_rate_error(state) / YAW_ERROR_SCALE)


def linear_velocity_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the magnitude of the horizontal velocity error (command minus velocity), heading frame, m/s.

    At large errors, this term still has a gradient, but the term `linear_velocity_tracking` is nearly constant.
    """
    forward = state.command[0] - state.heading_velocity[0]
    lateral = state.command[1] - state.heading_velocity[1]
    return sqrt(forward * forward + lateral * lateral)


def yaw_rate_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the magnitude of the yaw-rate error (command minus yaw rate about the vertical), rad/s."""
    return abs(state.command[2] - state.heading_velocity[2])


def vertical_velocity(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the squared vertical velocity of the trunk, (m/s)²."""
    return state.vertical_velocity * state.vertical_velocity


def roll_pitch_rate(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of the squared roll and pitch rates of the trunk, (rad/s)²."""
    roll, pitch, _ = state.angular_velocity
    return roll * roll + pitch * pitch


def tilt(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the squared sine of the angle between the trunk's z axis and the vertical."""
    x, y, _ = state.rotation[2]
    return x * x + y * y


def crouch(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the distance of the trunk below MIN_HEIGHT_FRACTION of the home height; 0 for a higher trunk.

    The home height is the height of the trunk in the home pose. The returned distance is a fraction of the home height.
    """
    shortfall = MIN_HEIGHT_FRACTION - state.height / state.standing_height
    return cast("ScalarOrBatch", where(shortfall > 0.0, shortfall, 0.0))


def action_rate(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (change of the joint target since the last control step)² over the joints, rad²."""
    return sum_of_squared_differences(state.action, state.previous_action)


def torque(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (joint torque)² over the joints, (N·m)²."""
    return sum_of_squares(state.joint_torque)


def mechanical_power(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the mechanical power, W: the sum over the joints of the absolute product of torque and velocity."""
    return state.mechanical_power


def foot_air_time(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (swing duration - NEUTRAL_SWING_TIME) over the feet that touch down in this step, s.

    The term is 0 if the norm of the command is at most `MAX_STAND_COMMAND`. The term is also 0 if the simulation does
    not measure swing durations. The simulation measures them only if a reward or observation term needs them. The term
    follows legged_gym (Rudin et al. 2022, `_reward_feet_air_time`) and Isaac Lab (`feet_air_time`). In these two
    projects, the term is also 0 for a command to turn on the spot.
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
    """Return Σ (downward speed)² over the feet that touch down in this step, (m/s)².

    The term is 0 if the simulation does not measure touchdown speeds. The simulation measures them only if a reward or
    observation term needs them.
    """
    return 0.0 * abs(state.height) if state.touchdown_speed is None else sum_of_squares(state.touchdown_speed)


def is_stand_command(state: QuadState[ScalarOrBatch]) -> Any:
    """Return True for robots with a zero velocity command, which are commanded to stand; a bool or (n,)."""
    return sum_of_squares(state.command) == 0.0


def gait(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the agreement of the foot motions with the gait clock, 0 to 1, averaged over the feet.

    The gait clock gives each leg a phase in its stride. A leg should swing while the sine of its phase is positive, and
    stand otherwise. The height of a swing foot, as a multiple of the mid-swing height, should be at least the sine, and
    at most `MAX_SWING_HEIGHT_RATIO`. A stance foot should not slip. Between sines of -0.5 and 0.5, the values for swing
    and stance are blended. All feet should stand if the command is zero. The term is 0 if there is no gait clock.
    """
    if state.leg_phase is None or state.foot_contact is None or state.foot_height is None or state.foot_speed is None:
        return 0.0 * abs(state.height)
    moves = where(is_stand_command(state), 0.0, 1.0)
    scale = SWING_HEIGHT_FRACTION * state.standing_height
    feet = zip(state.leg_phase, state.foot_contact, state.foot_height, state.foot_speed, strict=True)
    total: ScalarOrBatch = ordered_sum(
        _foot_agreement(moves * sin(phase), moves, contact, height / scale, speed)
        for phase, contact, height, speed in feet
    )
    return total / 4.0


def _foot_agreement(sine: Any, moves: Any, contact: Any, height: Any, speed: Any) -> Any:
    """Return the agreement of one foot with the gait clock, 0 to 1, a float or an array (n,).

    `sine` is the sine of the leg's phase, and 0 for a robot that should stand. `moves` is 1 for a robot that should
    move, and 0 for a robot that should stand. `contact` is True for a foot on the ground. `height` is the height of the
    foot, as a multiple of the mid-swing height. `speed` is the horizontal speed of the foot, m/s.
    """
    too_low = where(height < sine, sine - height, 0.0)
    too_high = where(height > MAX_SWING_HEIGHT_RATIO, height - MAX_SWING_HEIGHT_RATIO, 0.0)
    errors = (too_low * too_low + too_high * too_high) / SWING_HEIGHT_WIDTH_RATIO**2
    swing = where(contact, 0.0, exp(-errors))
    stance = where(contact, exp(-(speed * speed) / SLIP_SCALE), 0.0)
    share = moves * clip(0.5 + sine, 0.0, 1.0)
    return share * swing + (1.0 - share) * stance


def pose(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-Σ w e²), summed over the joints, from 0 to 1; e is a joint's deviation from the home pose, rad.

    The weights w are `POSE_WEIGHTS`, 1/rad².
    """
    deviations = differences(state.joint_position, state.home_pose)
    weighted: Iterable[ScalarOrBatch] = (w * e * e for w, e in zip(POSE_WEIGHTS * 4, deviations, strict=True))
    return exp(-ordered_sum(weighted))


def stand_still(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of the joints' absolute deviations from the home pose, rad, if the command is zero; else 0.

    The term follows legged_gym (Rudin et al. 2022, `_reward_stand_still`).
    """
    deviation: ScalarOrBatch = ordered_sum(map(abs, differences(state.joint_position, state.home_pose)))
    return cast("ScalarOrBatch", where(is_stand_command(state), deviation, 0.0))


def joint_limits(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum over the joints of the angle beyond the soft joint limits, rad; 0 within the limits.

    The soft limits bound the central `SOFT_LIMIT_FRACTION` of a joint's range.
    """
    joints = zip(state.joint_position, state.joint_lower, state.joint_upper, strict=True)
    excess: Iterable[ScalarOrBatch] = (
        abs(angle - (lower + upper) / 2.0) - SOFT_LIMIT_FRACTION * (upper - lower) / 2.0
        for angle, lower, upper in joints
    )
    total: ScalarOrBatch = ordered_sum(where(value > 0.0, value, 0.0) for value in excess)
    return total


def foot_slip(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (horizontal foot speed)² over the feet on the ground, (m/s)².

    The term is 0 if the simulation does not track the feet, which it does only if a term needs their motion.
    """
    if state.foot_contact is None or state.foot_speed is None:
        return 0.0 * abs(state.height)
    feet = zip(state.foot_contact, state.foot_speed, strict=True)
    total: ScalarOrBatch = ordered_sum(where(contact, speed * speed, 0.0) for contact, speed in feet)
    return total


def foot_clearance(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (height error)² · (horizontal speed) over the feet, m²·m/s.

    The height error is the height of a foot minus the desired mid-swing height, which is `SWING_HEIGHT_FRACTION` of the
    trunk's home height. The term is 0 if the simulation does not track the feet.
    """
    if state.foot_height is None or state.foot_speed is None:
        return 0.0 * abs(state.height)
    target = SWING_HEIGHT_FRACTION * state.standing_height
    feet = zip(state.foot_height, state.foot_speed, strict=True)
    total: ScalarOrBatch = ordered_sum((height - target) * (height - target) * speed for height, speed in feet)
    return total


RewardFunction = Callable[[QuadState[Any]], Any]
"""Type of a function of a `QuadState` that returns an unweighted reward term, a float or an array (n,)."""
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
    gait,
    pose,
    stand_still,
    joint_limits,
    foot_slip,
    foot_clearance,
)
"""Functions of the built-in reward terms; each has the same name as its weight in `RewardWeights`."""
_FUNCTION_OF: dict[str, RewardFunction] = {function.__name__: function for function in FUNCTIONS}
TERMS: dict[str, RewardFunction] = {
    f"{REWARD}{term.name}": _FUNCTION_OF[term.name] for term in fields(RewardWeights) if term.name != "fall"
}
"""Key of each built-in reward term in the infos -> its function; the term `fall` has no function and is absent."""
FALL = f"{REWARD}fall"
"""Key of the reward term `fall` in the infos.

The term penalises the end of an episode by a fall or by a diverged simulation.
"""
FOOT_TERMS = ("foot_air_time", "touchdown_speed", "gait", "foot_slip", "foot_clearance")
"""Names of the reward terms for which the simulation must track ground contacts and motion of the feet."""
OPTIONAL_TERMS = ("gait", "pose", "stand_still", "joint_limits", "foot_slip", "foot_clearance")
"""Names of the reward terms that are not computed, and have no key in the infos, if their weight is 0."""


@dataclass(frozen=True)
class StepWeights:
    """Factors on the built-in reward terms in one control step, see `step_weights`."""

    keys: tuple[str, ...]
    """Keys of the reward terms in the infos, in the order of `reward_terms`; the last one is `FALL`."""
    computed: tuple[tuple[str, float, RewardFunction], ...]
    """Key, factor and function of each reward term that is not always 0, except the term `fall`."""
    fall: float
    """Factor on the reward term `fall`."""

    @property
    def weighted_keys(self) -> tuple[str, ...]:
        """Keys of the reward terms that are not always 0."""
        fall = () if self.fall == 0.0 else (FALL,)
        return (*(key for key, _, _ in self.computed), *fall)


def step_weights(weights: RewardWeights, dt: float) -> StepWeights:
    """Compute the factor on each built-in reward term in one control step.

    The weights are rewards per second, so they are multiplied by the control period. The weight of `fall` is not
    multiplied, because a fall counts once. Terms in `OPTIONAL_TERMS` with the weight 0 are left out.

    Args:
        weights: Weights of the reward terms.
        dt: Control period, s.

    Returns:
        Keys, factors and functions of the reward terms.
    """
    rates = asdict(weights)
    fall = rates.pop("fall")
    used = [name for name, weight in rates.items() if weight != 0.0 or name not in OPTIONAL_TERMS]
    return StepWeights(
        keys=(*(f"{REWARD}{name}" for name in used), FALL),
        computed=tuple((f"{REWARD}{name}", rates[name] * dt, TERMS[f"{REWARD}{name}"]) for name in used if rates[name]),
        fall=fall,
    )


def reward_terms(
    state: QuadState[ScalarOrBatch], terminated: BoolOrMask, diverged: BoolOrMask, weights: StepWeights
) -> dict[str, ScalarOrBatch]:
    """Compute the weighted built-in reward terms of a control step.

    Args:
        state: State after the step.
        terminated: True for robots with an episode that ends in this step by a fall or a diverged simulation.
        diverged: True for robots with a diverged simulation; all their terms except `fall` are 0.
        weights: Factors on the terms, from `step_weights`.

    Returns:
        Key of each term in the infos -> weighted value, a float for one robot or an array (n,).
    """
    terms = zeros_by_key(weights.keys, state.height)
    for key, weight, function in weights.computed:
        terms[key] = weight * function(state)
    if any_true(diverged):
        terms = {key: where(diverged, 0.0, value) for key, value in terms.items()}
    terms[FALL] = weights.fall * where(terminated, 1.0, 0.0)
    return terms


@dataclass(frozen=True)
class UserReward:
    """Reward term that a user defined by the argument `rewards` of an environment."""

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
    """Check the argument `rewards` of an environment, and return the user's reward terms.

    Args:
        rewards: Name -> (function, weight), or name -> weight for a reward term that was registered by
            `add_extension`. None for no terms.

    Returns:
        Key of each term in the infos, `reward_<name>` -> term.

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
    """Return the registered reward function `name` of an extension; raise ValueError for an unknown name.

    `builtin` has the names of the built-in terms as keys; an extension must not use these names.
    """
    known = check_new("rewards", builtin)
    if name not in known:
        valid = ", ".join(known) or "none is installed"
        raise ValueError(f"rewards: unknown term {name!r}; valid: {valid}, or a pair (function, weight)")
    function: RewardFunction = known[name]
    return function
