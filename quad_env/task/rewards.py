"""Reward terms: pure functions of the state; the weights are in `config.RewardWeights`.

Every term accepts a state of one robot (floats) or of n robots (arrays), see `columns`. The tracking terms have the
usual exponential form. Their exponent contains the error e instead of e², because then small errors still give a
gradient.
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
    sum_of_squares,
    where,
)
from quad_env.config import RewardWeights
from quad_env.extensions import check_new
from quad_env.physics.state import QuadState

LINEAR_ERROR_SCALE = 0.25
"""Error of the planar velocity at which the reward `linear_velocity_tracking` is exp(-1), m/s."""
YAW_ERROR_SCALE = 0.25
"""Error of the yaw rate at which the reward `yaw_rate_tracking` is exp(-1), rad/s."""
NEUTRAL_SWING_TIME = 0.15
"""Swing duration at which the reward `foot_air_time` is 0, about the swing duration of a trot, s.

Longer swings increase the reward, and shorter swings decrease it.
"""
MIN_HEIGHT_FRACTION = 0.85
"""Trunk height below which the term `crouch` is above 0, as a fraction of the trunk height in the home pose."""
MAX_STAND_COMMAND = 0.1
"""Largest norm of a velocity command (forward m/s, lateral m/s, yaw rate rad/s) that means "stand still"."""
SWING_HEIGHT_FRACTION = 0.2
"""Height of the underside of a foot at mid-swing, as a fraction of the home trunk height; 0.06 m for go1."""
MAX_SWING_HEIGHT_RATIO = 1.25
"""Height of a swing foot above which the gait reward falls again, relative to the height at mid-swing."""
SWING_HEIGHT_WIDTH_RATIO = 0.6
"""Height error at which the gait reward of a swing foot is 1/e, relative to the height at mid-swing."""
SLIP_SCALE = 0.05
"""Squared horizontal foot speed at which the gait reward of a stance foot is 1/e, (m/s)²."""
POSE_WEIGHTS = (1.0, 1.0, 0.1)
"""Weights of hip, thigh and calf in the pose reward, 1/rad²; swinging legs bend the knees most."""
SOFT_LIMIT_FRACTION = 0.95
"""Central fraction of a joint's range in which the term `joint_limits` is zero."""


def linear_velocity_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-‖e‖ / LINEAR_ERROR_SCALE) with the planar velocity error e, heading frame, m/s.

    The error is the command minus the velocity of the trunk.
    """
    return exp(-linear_velocity_error(state) / LINEAR_ERROR_SCALE)


def yaw_rate_tracking(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-‖e‖ / YAW_ERROR_SCALE) with the yaw-rate error e about the world's vertical, rad/s.

    The error is the commanded yaw rate minus the yaw rate of the trunk.
    """
    return exp(-yaw_rate_error(state) / YAW_ERROR_SCALE)


def linear_velocity_error(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the magnitude of the planar velocity error (command minus velocity), heading frame, m/s.

    This term has a gradient at large errors too, but the exponential term `linear_velocity_tracking` hardly has one.
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
    x, y, _ = state.projected_gravity
    return x * x + y * y


def crouch(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return how far the trunk is below MIN_HEIGHT_FRACTION of the home height; 0 if it is higher.

    The home height is the height of the trunk in the home pose. The distance is a fraction of the home height.
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
    """Return Σ (swing duration - NEUTRAL_SWING_TIME) over the feet that touch down in this step, s.

    The term is 0 if the command means "stand still", see `MAX_STAND_COMMAND`. It is also 0 if the simulation does not
    measure swings, which it does only if a reward or observation term needs them. The term follows legged_gym (Rudin et
    al. 2022, `_reward_feet_air_time`) and Isaac Lab (`feet_air_time`). In both, the term is also 0 for a command to
    turn on the spot.
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

    The term is 0 if the simulation does not measure touchdowns, which it does only if a reward or observation term
    needs them.
    """
    return 0.0 * abs(state.height) if state.touchdown_speed is None else sum_of_squares(state.touchdown_speed)


def is_stand_command(state: QuadState[ScalarOrBatch]) -> Any:
    """Return True for robots that are commanded to stand: all components of the command are zero."""
    return sum_of_squares(state.command) == 0.0


def gait(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the mean over the feet, 0 to 1, of the agreement between foot motion and gait clock.

    A leg with a positive sine of its phase has to swing, at a height in proportion to the sine; the others have to
    stand without slip. All feet have to stand if the command is zero. The term is 0 without a clock.
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
    """Return the agreement of a foot with the clock, 0 to 1, from the `sine` of its phase and its motion.

    `height` is relative to the mid-swing height, `moves` is 0 for a robot that has to stand and 1 for others.
    """
    too_low = where(height < sine, sine - height, 0.0)
    too_high = where(height > MAX_SWING_HEIGHT_RATIO, height - MAX_SWING_HEIGHT_RATIO, 0.0)
    errors = (too_low * too_low + too_high * too_high) / SWING_HEIGHT_WIDTH_RATIO**2
    swing = where(contact, 0.0, exp(-errors))
    stance = where(contact, exp(-(speed * speed) / SLIP_SCALE), 0.0)
    share = moves * clip(0.5 + sine, 0.0, 1.0)
    return share * swing + (1.0 - share) * stance


def pose(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return exp(-Σ w e²) of the deviation e of the joints from the home pose, with the weights `POSE_WEIGHTS`."""
    deviations = differences(state.joint_position, state.home_pose)
    weighted: Iterable[ScalarOrBatch] = (w * e * e for w, e in zip(POSE_WEIGHTS * 4, deviations, strict=True))
    return exp(-ordered_sum(weighted))


def stand_still(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ ‖e‖ of the joints' deviation e from the home pose, rad, if the command is zero; otherwise 0.

    See legged_gym (Rudin et al. 2022, `_reward_stand_still`).
    """
    deviation: ScalarOrBatch = ordered_sum(map(abs, differences(state.joint_position, state.home_pose)))
    return cast("ScalarOrBatch", where(is_stand_command(state), deviation, 0.0))


def joint_limits(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return how far the joints are outside of the central `SOFT_LIMIT_FRACTION` of their range, rad, summed."""
    joints = zip(state.joint_position, state.joint_lower, state.joint_upper, strict=True)
    excess: Iterable[ScalarOrBatch] = (
        abs(angle - (lower + upper) / 2.0) - SOFT_LIMIT_FRACTION * (upper - lower) / 2.0
        for angle, lower, upper in joints
    )
    total: ScalarOrBatch = ordered_sum(where(value > 0.0, value, 0.0) for value in excess)
    return total


def foot_slip(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (horizontal speed)² over the feet in contact, (m/s)²; 0 if the simulation does not track feet."""
    if state.foot_contact is None or state.foot_speed is None:
        return 0.0 * abs(state.height)
    feet = zip(state.foot_contact, state.foot_speed, strict=True)
    total: ScalarOrBatch = ordered_sum(where(contact, speed * speed, 0.0) for contact, speed in feet)
    return total


def foot_clearance(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ (height error)² · (horizontal speed) over the feet, m²·m/s; 0 if the simulation does not track feet.

    The height error is relative to the mid-swing height, `SWING_HEIGHT_FRACTION` of the home height.
    """
    if state.foot_height is None or state.foot_speed is None:
        return 0.0 * abs(state.height)
    target = SWING_HEIGHT_FRACTION * state.standing_height
    feet = zip(state.foot_height, state.foot_speed, strict=True)
    total: ScalarOrBatch = ordered_sum((height - target) * (height - target) * speed for height, speed in feet)
    return total


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
    gait,
    pose,
    stand_still,
    joint_limits,
    foot_slip,
    foot_clearance,
)
"""Functions of the built-in reward terms; a function and its weight in `RewardWeights` have the same name."""
_FUNCTION_OF: dict[str, RewardFunction] = {function.__name__: function for function in FUNCTIONS}
TERMS: dict[str, RewardFunction] = {
    f"{REWARD}{term.name}": _FUNCTION_OF[term.name] for term in fields(RewardWeights) if term.name != "fall"
}
"""Key of each built-in reward term in the infos -> function; the term `fall`, which has no function, is absent."""
FALL = f"{REWARD}fall"
"""Key of the reward term `fall` in the infos, which penalises a fall or diverged simulation that ends an episode."""
FOOT_TERMS = ("foot_air_time", "touchdown_speed", "gait", "foot_slip", "foot_clearance")
"""Names of the terms that need contacts and motion of the feet."""
OPTIONAL_TERMS = ("gait", "pose", "stand_still", "joint_limits", "foot_slip", "foot_clearance")
"""Names of the terms that are left out, also in the infos, if their weight is 0."""


def step_weights(weights: RewardWeights, dt: float) -> dict[str, float]:
    """Compute the factor on each built-in reward term in one control step, without optional terms of weight 0.

    The weights are rewards per second, so they are multiplied by the control period. The weight of `fall` is not
    multiplied, because a fall counts once.

    Args:
        weights: Weights of the reward terms.
        dt: Control period, s.

    Returns:
        Key of each reward term in the infos -> factor, in the order of `reward_terms`.
    """
    used = {name: weight for name, weight in asdict(weights).items() if weight != 0.0 or name not in OPTIONAL_TERMS}
    rates = {f"{REWARD}{name}": weight for name, weight in used.items()}
    fall = rates.pop(FALL)
    return {key: weight * dt for key, weight in rates.items()} | {FALL: fall}


def reward_terms(
    state: QuadState[ScalarOrBatch], terminated: BoolOrMask, diverged: BoolOrMask, weights: dict[str, float]
) -> dict[str, ScalarOrBatch]:
    """Compute the weighted built-in reward terms of a control step.

    Args:
        state: State after the step.
        terminated: True for robots with an episode that ends in this step by a fall or a diverged simulation.
        diverged: True for robots with a diverged simulation; all their terms except `fall` are 0.
        weights: Key of each term in the infos -> factor, from `step_weights`.

    Returns:
        Key of each term in the infos -> weighted value, a float for one robot or an array (n,).
    """
    terms = {key: weights[key] * term(state) for key, term in TERMS.items() if key in weights}
    if any_true(diverged):
        terms = {key: where(diverged, 0.0, value) for key, value in terms.items()}
    terms[FALL] = weights[FALL] * where(terminated, 1.0, 0.0)
    return terms


@dataclass(frozen=True)
class UserReward:
    """Reward term that a user defined by the argument `rewards` of an environment."""

    name: str
    function: RewardFunction
    weight: float
    """Factor on the value of `function`, as reward per second."""

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
