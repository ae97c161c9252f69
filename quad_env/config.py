"""Settings of the environment as frozen dataclasses that raise ValueError for invalid values."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_type_hints

import numpy as np

from quad_env.type_check import is_instance_of

GRAVITY = 9.81
"""Gravitational acceleration in all scenarios, m/s²."""
MIN_TRUNK_HEIGHT_RATIO = 0.2
"""Trunk height above the terrain below which a robot has fallen, as a fraction of the leg length."""
COMMAND_BOUND = 100.0
"""Largest valid magnitude of each component of a velocity command, m/s or rad/s.

The command in the observation is also clipped to this magnitude.
"""


class Bounds(NamedTuple):
    """Range of the valid numbers of a setting, for use in the type annotation `Annotated[float, Bounds(...)]`."""

    description: str
    """Range in words, such as `from 0 to 1`, for the error message `<field> must be <description>`."""
    minimum: float
    """Smallest valid number of the setting, in the unit of the setting."""
    maximum: float = sys.float_info.max
    """Largest valid number of the setting, in the unit of the setting."""


Finite = Annotated[float, Bounds("finite", -sys.float_info.max)]
"""Type of a setting that must be a finite number."""
NonNegative = Annotated[float, Bounds("finite and at least 0", 0.0)]
"""Type of a setting that must be a finite number of at least 0."""
Positive = Annotated[float, Bounds("finite and more than 0", sys.float_info.min)]
"""Type of a setting that must be a finite number above 0."""
Fraction = Annotated[float, Bounds("from 0 to 1", 0.0, 1.0)]
"""Type of a setting that must be a number from 0 to 1."""


def check_settings(settings: Any) -> None:
    """Check that each field of a settings object has the annotated type and a number within its bounds.

    Args:
        settings: Instance of a settings dataclass, such as `CommandRanges`.

    Raises:
        ValueError: A field has a wrong type or a number out of bounds; the message names the first wrong field.
    """
    settings_class: Any = type(settings)
    for name, (kind, bounds) in _annotations(settings_class).items():
        value = getattr(settings, name)
        label = f"{settings_class.__name__}.{name}"
        if not is_instance_of(value, kind):
            raise ValueError(f"{label} is of the type {getattr(kind, '__name__', kind)}, got {value!r:.80}")
        if value is not None:
            _check_bounds(label, value, bounds)


def _check_bounds(label: str, value: Any, bounds: tuple[Bounds, ...]) -> None:
    """Check that a setting, or each number of a setting that is a tuple or array, is within its bounds.

    Args:
        label: Name of the setting, for the error message.
        value: Number, tuple of numbers or array of numbers.
        bounds: Ranges; each number must be in all of them.

    Raises:
        ValueError: A number is out of bounds.
    """
    for bound in bounds:
        numbers = np.ravel(value).tolist()
        if any(isinstance(number, bool) or not bound.minimum <= number <= bound.maximum for number in numbers):
            raise ValueError(f"{label} must be {bound.description}, got {value!s:.80}")


@cache
def _annotations(settings_class: type) -> dict[str, tuple[Any, tuple[Bounds, ...]]]:
    """Return a dictionary for a settings dataclass: name of a field -> its type, and bounds of its numbers."""
    annotated = get_type_hints(settings_class, include_extras=True)
    return {name: (kind, tuple(_bounds(annotated[name]))) for name, kind in get_type_hints(settings_class).items()}


def _bounds(hint: Any) -> Iterator[Bounds]:
    """Yield all `Bounds` in the type annotation `hint`, also within `tuple[...]`, `... | None` and similar."""
    yield from (item for item in getattr(hint, "__metadata__", ()) if isinstance(item, Bounds))
    for part in get_args(hint):
        yield from _bounds(part)


class Settings:
    """Base class of settings dataclasses; the constructor raises ValueError if a field is invalid."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class CommandRanges(Settings):
    """Ranges from which velocity commands are drawn uniformly, at the start of an episode and at intervals.

    Commands are in the heading frame, which has the trunk's forward direction, projected onto the horizontal plane, as
    its x axis.
    """

    forward: tuple[float, float] = (-1.0, 1.5)
    """Smallest and largest forward velocity, m/s"""
    lateral: tuple[float, float] = (-0.8, 0.8)
    """Smallest and largest lateral velocity, positive to the left, m/s"""
    yaw_rate: tuple[float, float] = (-1.2, 1.2)
    """Smallest and largest yaw rate, positive to the left, rad/s"""
    zero_fraction: Fraction = 0.1
    """Probability that a draw gives the zero command, with which the robot should stand"""
    interval: Annotated[float, Bounds("from 0.01 s to 1e6 s", 0.01, 1e6)] = 5.0
    """Time between two draws of a command, s; the mean time if `random_intervals` is True"""
    random_intervals: bool = False
    """True to draw the time between two draws from an exponential distribution"""
    on_probability: tuple[Fraction, Fraction, Fraction] = (1.0, 1.0, 1.0)
    """Probability that a component (forward, lateral, yaw rate) is drawn from its range; otherwise it is 0"""
    keep_probability: Fraction = 0.0
    """Probability that a component keeps its value at a draw after the first draw of an episode"""

    @property
    def draws_components(self) -> bool:
        """True if each component of a command can be zero or keep its value, independently of other components."""
        return self.keep_probability > 0.0 or self.on_probability != (1.0, 1.0, 1.0)

    def steps(self, dt: float) -> int:
        """Return the number of control steps for which a command is kept; `dt` is the control period, s."""
        return round(self.interval / dt)

    @classmethod
    def straight(cls, speed: float) -> "CommandRanges":
        """Return ranges that contain only one command: move straight forward at `speed`, m/s."""
        return cls((speed, speed), (0.0, 0.0), (0.0, 0.0), zero_fraction=0.0)

    def scaled(self, velocity_factor: float, yaw_rate_factor: float) -> "CommandRanges":
        """Return a copy with scaled ranges, such as for a robot of another size.

        Args:
            velocity_factor: Factor on the forward and lateral velocities.
            yaw_rate_factor: Factor on the yaw rates.

        Returns:
            The scaled ranges.
        """
        return replace(
            self,
            forward=_scaled_range(self.forward, velocity_factor),
            lateral=_scaled_range(self.lateral, velocity_factor),
            yaw_rate=_scaled_range(self.yaw_rate, yaw_rate_factor),
        )

    def times(self, velocity_factor: float, yaw_rate_factor: float) -> "CommandRanges":
        """Return `scaled(velocity_factor, yaw_rate_factor)`; deprecated name of `scaled`."""
        return self.scaled(velocity_factor, yaw_rate_factor)

    def __post_init__(self) -> None:
        super().__post_init__()
        for low, high in (self.forward, self.lateral, self.yaw_rate):
            if not -COMMAND_BOUND <= low <= high <= COMMAND_BOUND:
                raise ValueError(f"a command range must rise within ±{COMMAND_BOUND:g}, got ({low}, {high})")


def _scaled_range(values: tuple[float, float], factor: float) -> tuple[float, float]:
    """Return a range, `values` (smallest, largest), with both ends multiplied by `factor`."""
    low, high = values
    return factor * low, factor * high


@dataclass(frozen=True)
class StartNoise(Settings):
    """Uniform random noise that is added to the start state of an episode, the home pose at rest.

    Each field is the largest magnitude of the noise; the noise is drawn from -field to +field.
    """

    yaw: float = 3.141592653589793
    """Largest start yaw angle, rad; a full circle, so that policies cannot rely on equal heading and world frames"""
    tilt: float = 0.03
    """Largest start roll and pitch angle, rad; drawn between minus and plus this value"""
    joint_position: float = 0.05
    """Largest start offset of each joint from the home pose, rad; drawn between minus and plus this value"""
    joint_velocity: float = 0.1
    """Largest start speed of each joint, rad/s; drawn between minus and plus this value"""
    linear_velocity: float = 0.1
    """Largest start velocity of the trunk along each world axis, m/s; drawn between minus and plus this value"""
    angular_velocity: float = 0.1
    """Largest start angular velocity about each axis of the base frame, rad/s; drawn from minus to plus this value"""


@dataclass(frozen=True)
class AnyPose(Settings):
    """Random start state of an episode, as after a fall: any orientation, any joint angles, and velocities.

    The robot's lowest point is on the ground. Orientations are drawn uniformly, and joint angles uniformly within the
    joint limits. Each field is the largest magnitude of a velocity, which is drawn uniformly from -field to +field.
    """

    joint_velocity: float = 3.0
    """Largest start speed of each joint, rad/s; drawn between minus and plus this value"""
    linear_velocity: float = 1.0
    """Largest start velocity of the trunk along each world axis, m/s; drawn between minus and plus this value"""
    angular_velocity: float = 3.0
    """Largest start angular velocity about each axis of the base frame, rad/s; drawn from minus to plus this value"""


@dataclass(frozen=True)
class FallRule(Settings):
    """Limits of tilt and height beyond which a robot has fallen; trunk contact is always a fall."""

    name: str = "simple-quad/1"
    """Name of the fall rule, which is stored with every evaluation result"""
    tilt: float = 1.2217304763960306
    """Maximum angle between the trunk's z axis and the vertical, rad; the default is 70°"""
    height: float | None = None
    """Minimum height of the trunk centre above the terrain below it, m; None for a fifth of the leg length (SimpleQuad:
    0.12 m)"""

    def min_trunk_height(self, leg_length: float) -> float:
        """Return the height of the trunk above the terrain, m, below which a robot has fallen.

        `leg_length` is the leg length of the robot, m.
        """
        return MIN_TRUNK_HEIGHT_RATIO * leg_length if self.height is None else self.height

    def lowest(self, leg_length: float) -> float:
        """Return `min_trunk_height(leg_length)`; deprecated name of `min_trunk_height`."""
        return self.min_trunk_height(leg_length)


FALL_RULE = FallRule().name
"""Name of the default fall rule, which is stored with every evaluation result."""
FALL_REASONS = ("none", "trunk_contact", "tilt", "height")
"""Names of the reasons of a fall, indexed by the number in `info["fall"]`; 0 means no fall.

If several reasons apply, the first one in this order counts.
"""


@dataclass(frozen=True)
class RewardWeights(Settings):
    """Weight of each reward term, as reward per second; only the weight of `fall` counts once, at the fall.

    The function of a term in `quad_env.task.rewards` has the same name as its weight.
    """

    linear_velocity_tracking: float = 1.2
    yaw_rate_tracking: float = 0.8
    linear_velocity_error: float = 0.0
    yaw_rate_error: float = 0.0
    vertical_velocity: float = -0.5
    roll_pitch_rate: float = -0.02
    tilt: float = -0.5
    crouch: float = 0.0
    action_rate: float = -0.02
    torque: float = -2e-5
    mechanical_power: float = 0.0
    foot_air_time: float = 0.0
    touchdown_speed: float = 0.0
    gait: float = 0.0
    pose: float = 0.0
    stand_still: float = 0.0
    joint_limits: float = 0.0
    foot_slip: float = 0.0
    foot_clearance: float = 0.0
    fall: float = -1.0


@dataclass(frozen=True)
class PhysicsOptions(Settings):
    """Simplifications of the physics that make training faster; none by default."""

    contacts: Literal["all", "feet-trunk", "feet"] = "all"
    """Geoms of the robot that collide: all, feet and trunk, or only feet. With only feet, a fall is detected by tilt
    and height of the trunk"""
    cone: Literal["model", "pyramidal", "elliptic"] = "model"
    """Friction cone of the contacts; model: the cone that the robot's MJCF defines"""
    joint_friction: Literal["model", "none"] = "model"
    """Dry friction of the joints; none: remove it, which saves the solver one constraint per joint"""


@dataclass(frozen=True)
class TaskConfig(Settings):
    """Settings of the task: control rate, physics step, fall rule and reward weights."""

    control_rate: float = 100.0
    """Control rate, at which the policy observes and acts, Hz"""
    timestep: Positive | None = None
    """Step of the physics and the joint servos, s; None for the value in the MJCF of the robot"""
    solver_iterations: Annotated[int, Bounds("at least 1", 1)] | None = None
    """Maximum iterations of the contact solver per physics step; None for the value in the MJCF of the robot"""
    physics: PhysicsOptions = field(default_factory=PhysicsOptions)
    fall_rule: FallRule = field(default_factory=FallRule)
    reward_weights: RewardWeights = field(default_factory=RewardWeights)
