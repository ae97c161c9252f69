"""Settings of the environment as frozen dataclasses, which are checked when they are made."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import numpy as np
from typeguard import CollectionCheckStrategy, TypeCheckError, check_type

GRAVITY = 9.81
"""m/s². Gravitational acceleration of every world."""
MIN_TRUNK_HEIGHT_RATIO = 0.2
"""Height of the trunk's centre, as a fraction of the leg length, below which a robot has fallen."""
COMMAND_BOUND = 100.0
"""m/s and rad/s. Largest magnitude of a command that the observation can show."""


class Bounds(NamedTuple):
    """Range of valid numbers of a setting, for its annotation."""

    description: str
    """The range in words, after `must be`."""
    minimum: float
    """Smallest valid number."""
    maximum: float = sys.float_info.max
    """Largest valid number."""


Finite = Annotated[float, Bounds("finite", -sys.float_info.max)]
NonNegative = Annotated[float, Bounds("finite and at least 0", 0.0)]
Positive = Annotated[float, Bounds("finite and more than 0", sys.float_info.min)]
Fraction = Annotated[float, Bounds("from 0 to 1", 0.0, 1.0)]


def check_settings(settings: Any) -> None:
    """Check the fields of a dataclass against their annotations.

    Args:
        settings: The dataclass instance.

    Raises:
        ValueError: A field has another type, or a number out of its bounds; one line, for the first of them.
    """
    settings_class: Any = type(settings)
    for name, (kind, bounds) in _annotations(settings_class).items():
        value = getattr(settings, name)
        label = f"{settings_class.__name__}.{name}"
        try:
            check_type(value, kind, collection_check_strategy=CollectionCheckStrategy.ALL_ITEMS)
        except TypeCheckError:
            raise ValueError(f"{label} is of the type {getattr(kind, '__name__', kind)}, got {value!r:.80}") from None
        if value is not None:
            _check_bounds(label, value, bounds)


def _check_bounds(label: str, value: Any, bounds: tuple[Bounds, ...]) -> None:
    """Raise ValueError for a number, also in a tuple or array, out of one of the bounds."""
    numbers = np.ravel(value).tolist()
    for bound in bounds:
        if any(isinstance(number, bool) or not bound.minimum <= number <= bound.maximum for number in numbers):
            raise ValueError(f"{label} must be {bound.description}, got {value!s:.80}")


@cache
def _annotations(settings_class: type) -> dict[str, tuple[Any, tuple[Bounds, ...]]]:
    """Return the type and the bounds of each field."""
    annotated = get_type_hints(settings_class, include_extras=True)
    return {name: (kind, tuple(_bounds(annotated[name]))) for name, kind in get_type_hints(settings_class).items()}


def _bounds(hint: Any) -> Iterator[Bounds]:
    """Yield the bounds in an annotation and in its parts."""
    yield from (item for item in getattr(hint, "__metadata__", ()) if isinstance(item, Bounds))
    for part in get_args(hint):
        yield from _bounds(part)


class Settings:
    """Base of dataclasses that are checked against their annotations when they are made; ValueError otherwise."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class CommandRanges(Settings):
    """Ranges of velocity commands in the heading frame, drawn uniformly at reset and at every interval."""

    forward: tuple[float, float] = (-1.0, 1.5)
    """m/s"""
    lateral: tuple[float, float] = (-0.8, 0.8)
    """m/s, positive to the left"""
    yaw_rate: tuple[float, float] = (-1.2, 1.2)
    """rad/s, positive to the left"""
    zero_fraction: Fraction = 0.1
    """Fraction of draws that are the zero command."""
    interval: Annotated[float, Bounds("from 0.01 s to 1e6 s", 0.01, 1e6)] = 5.0
    """s between draws"""

    def steps(self, dt: float) -> int:
        """Return the duration of a command in control steps of period `dt`, s."""
        return round(self.interval / dt)

    @classmethod
    def straight(cls, speed: float) -> "CommandRanges":
        """Return ranges that always give a command straight ahead at `speed`, m/s."""
        return cls((speed, speed), (0.0, 0.0), (0.0, 0.0), zero_fraction=0.0)

    def scaled(self, velocity_factor: float, yaw_rate_factor: float) -> "CommandRanges":
        """Return the ranges with velocities times `velocity_factor` and yaw rates times `yaw_rate_factor`."""
        return replace(
            self,
            forward=_scaled_range(self.forward, velocity_factor),
            lateral=_scaled_range(self.lateral, velocity_factor),
            yaw_rate=_scaled_range(self.yaw_rate, yaw_rate_factor),
        )

    def times(self, velocity_factor: float, yaw_rate_factor: float) -> "CommandRanges":
        """Call `scaled(velocity_factor, yaw_rate_factor)`. Deprecated name."""
        return self.scaled(velocity_factor, yaw_rate_factor)

    def __post_init__(self) -> None:
        super().__post_init__()
        for low, high in (self.forward, self.lateral, self.yaw_rate):
            if not -COMMAND_BOUND <= low <= high <= COMMAND_BOUND:
                raise ValueError(f"a command range must rise within ±{COMMAND_BOUND:g}, got ({low}, {high})")


def _scaled_range(values: tuple[float, float], factor: float) -> tuple[float, float]:
    """Return both ends of a range times a factor."""
    low, high = values
    return factor * low, factor * high


@dataclass(frozen=True)
class StartNoise(Settings):
    """Uniform noise around the home pose at the start of an episode; each value is a half-width."""

    yaw: float = 3.141592653589793
    """rad; the full circle, so that no result depends on equal heading and world frames"""
    tilt: float = 0.03
    """rad; of roll and of pitch"""
    joint_position: float = 0.05
    """rad"""
    joint_velocity: float = 0.1
    """rad/s"""
    linear_velocity: float = 0.1
    """m/s along each world axis"""
    angular_velocity: float = 0.1
    """rad/s about each body axis"""


@dataclass(frozen=True)
class AnyPose(Settings):
    """Starts of a fallen robot, with its lowest point on the ground; each value is the half-width of a velocity.

    Orientations are uniform, and joint angles are uniform within their limits.
    """

    joint_velocity: float = 3.0
    """rad/s"""
    linear_velocity: float = 1.0
    """m/s along each world axis"""
    angular_velocity: float = 3.0
    """rad/s about each body axis"""


@dataclass(frozen=True)
class FallRule(Settings):
    """Conditions for a fall, besides contact of the trunk with the ground."""

    name: str = "simple-quad/1"
    """Name of the rule, which is stored with every result"""
    tilt: float = 1.2217304763960306
    """rad; maximum angle between the trunk's z axis and the vertical, 70 degrees"""
    height: float | None = None
    """m; minimum height of the trunk's centre above the terrain below it; None for a fifth of the leg length,
    SimpleQuad's 0.12 m"""

    def min_trunk_height(self, leg_length: float) -> float:
        """Return the trunk height, m, below which a robot with this `leg_length`, m, has fallen."""
        return MIN_TRUNK_HEIGHT_RATIO * leg_length if self.height is None else self.height

    def lowest(self, leg_length: float) -> float:
        """Call `min_trunk_height(leg_length)`. Deprecated name."""
        return self.min_trunk_height(leg_length)


FALL_RULE = FallRule().name
FALL_REASONS = ("none", "trunk_contact", "tilt", "height")
"""Name of each code in `info["fall"]`; the first of several reasons counts."""


@dataclass(frozen=True)
class RewardWeights(Settings):
    """Weight of each reward term, a function of the same name in `quad_env.task.rewards`."""

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
    fall: float = -1.0


@dataclass(frozen=True)
class TaskConfig(Settings):
    """Settings of the task: rates, fall rule and rewards."""

    control_rate: float = 100.0
    """Hz; rate of observations and actions"""
    timestep: Positive | None = None
    """s; step of the physics and the joint servos; None for the value of the robot's MJCF"""
    solver_iterations: Annotated[int, Bounds("at least 1", 1)] | None = None
    """Maximum iterations of the contact solver per physics step; None for the value of the robot's MJCF"""
    fall_rule: FallRule = field(default_factory=FallRule)
    reward_weights: RewardWeights = field(default_factory=RewardWeights)
