"""Settings of the environment as frozen dataclasses; units in each docstring."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import numpy as np
from typeguard import CollectionCheckStrategy, TypeCheckError, check_type

GRAVITY = 9.81
"""Gravity of every world, m/s²."""
MIN_TRUNK_HEIGHT_RATIO = 0.2
"""Height of the trunk's centre, in leg lengths, below which a robot has fallen."""
COMMAND_BOUND = 100.0
"""Largest command that the observation can show, m/s and rad/s."""


class Bounds(NamedTuple):
    """What the numbers of a setting may be, for its annotation: in words, and from where to where."""

    description: str
    minimum: float
    maximum: float = sys.float_info.max


Finite = Annotated[float, Bounds("finite", -sys.float_info.max)]
NonNegative = Annotated[float, Bounds("finite and at least 0", 0.0)]
Positive = Annotated[float, Bounds("finite and more than 0", sys.float_info.min)]
Fraction = Annotated[float, Bounds("from 0 to 1", 0.0, 1.0)]


def check_settings(settings: Any) -> None:
    """Raise ValueError, one line, for the first field of a dataclass that is not as its annotation says."""
    of: Any = type(settings)
    for name, (kind, limits) in _fields(of).items():
        value, what = getattr(settings, name), f"{of.__name__}.{name}"
        try:
            check_type(value, kind, collection_check_strategy=CollectionCheckStrategy.ALL_ITEMS)
        except TypeCheckError:
            raise ValueError(f"{what} is of the type {getattr(kind, '__name__', kind)}, got {value!r:.80}") from None
        for bounds in () if value is None else limits:
            numbers = np.ravel(value).tolist()
            if any(isinstance(each, bool) or not bounds.minimum <= each <= bounds.maximum for each in numbers):
                raise ValueError(f"{what} must be {bounds.description}, got {value!s:.80}")


@cache
def _fields(of: type) -> dict[str, tuple[Any, tuple[Bounds, ...]]]:
    """Type and bounds of each field."""
    annotated = get_type_hints(of, include_extras=True)
    return {name: (kind, tuple(_bounds(annotated[name]))) for name, kind in get_type_hints(of).items()}


def _bounds(hint: Any) -> Iterator[Bounds]:
    """The bounds in an annotation and in its parts."""
    yield from (each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Bounds))
    for part in get_args(hint):
        yield from _bounds(part)


class Settings:
    """Dataclasses that are checked by their annotations when they are made; ValueError for what does not fit."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class CommandRanges(Settings):
    """Velocity commands in the heading frame, drawn uniformly at reset and again at every interval."""

    forward: tuple[float, float] = (-1.0, 1.5)
    """m/s"""
    lateral: tuple[float, float] = (-0.8, 0.8)
    """m/s, positive to the left"""
    yaw_rate: tuple[float, float] = (-1.2, 1.2)
    """rad/s, positive to the left"""
    zero_fraction: Fraction = 0.1
    """Share of draws that are the zero command."""
    interval: Annotated[float, Bounds("from 0.01 s to 1e6 s", 0.01, 1e6)] = 5.0
    """s between draws"""

    def steps(self, dt: float) -> int:
        """Control steps that a command lasts; `dt` is the control step, s."""
        return round(self.interval / dt)

    @classmethod
    def straight(cls, speed: float) -> "CommandRanges":
        """Always straight ahead at that speed, m/s."""
        return cls((speed, speed), (0.0, 0.0), (0.0, 0.0), zero_fraction=0.0)

    def scaled(self, faster: float, turning: float) -> "CommandRanges":
        """These ranges with so many times the velocities and so many times the yaw rates."""
        forward, lateral = ((faster * low, faster * high) for low, high in (self.forward, self.lateral))
        clockwise, anticlockwise = self.yaw_rate
        yaw_rate = (turning * clockwise, turning * anticlockwise)
        return replace(self, forward=forward, lateral=lateral, yaw_rate=yaw_rate)

    def __post_init__(self) -> None:
        super().__post_init__()
        for low, high in (self.forward, self.lateral, self.yaw_rate):
            if not -COMMAND_BOUND <= low <= high <= COMMAND_BOUND:
                raise ValueError(f"a command range must rise within ±{COMMAND_BOUND:g}, got ({low}, {high})")


@dataclass(frozen=True)
class StartNoise(Settings):
    """Uniform noise about the home pose at the start of an episode; each figure is the half-width."""

    yaw: float = 3.141592653589793
    """rad; the full circle, so that no result can rest on heading and world frames being the same"""
    tilt: float = 0.03
    """rad, roll and pitch each"""
    joint_position: float = 0.05
    """rad"""
    joint_velocity: float = 0.1
    """rad/s"""
    linear_velocity: float = 0.1
    """m/s, each world axis"""
    angular_velocity: float = 0.1
    """rad/s, each body axis"""


@dataclass(frozen=True)
class AnyPose(Settings):
    """Starts of a robot that has fallen: every orientation alike, joints anywhere within their limits, lowest point on
    the ground; each figure is the half-width of a uniform velocity."""

    joint_velocity: float = 3.0
    """rad/s"""
    linear_velocity: float = 1.0
    """m/s, each world axis"""
    angular_velocity: float = 3.0
    """rad/s, each body axis"""


@dataclass(frozen=True)
class FallRule(Settings):
    """When a robot counts as fallen; the rule's name is stored with every result."""

    name: str = "simple-quad/1"
    tilt: float = 1.2217304763960306
    """rad, 70 degrees, between the trunk's z axis and the vertical"""
    height: float | None = None
    """m, trunk centre above the terrain below it; None for a fifth of the robot's leg, SimpleQuad's 0.12 m"""

    def min_trunk_height(self, leg_length: float) -> float:
        """Height below which a robot on legs of that length, m, has fallen, m."""
        return MIN_TRUNK_HEIGHT_RATIO * leg_length if self.height is None else self.height


FALL_RULE = FallRule().name
FALL_REASONS = ("none", "trunk_contact", "tilt", "height")
"""Name of each code that `info["fall"]` can hold; of several reasons, the first counts."""


@dataclass(frozen=True)
class RewardWeights(Settings):
    """Weight of each reward term; the terms are functions of the same names in `quad_env.task.rewards`."""

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
    """What the environment adds to the physics."""

    control_rate: float = 100.0
    """Hz"""
    timestep: Positive | None = None
    """s a step of the physics and the joint servo; None for that of the robot's MJCF"""
    solver_iterations: Annotated[int, Bounds("at least 1", 1)] | None = None
    """most iterations of the contact solver a step of the physics; None for those of the robot's MJCF"""
    fall_rule: FallRule = field(default_factory=FallRule)
    reward_weights: RewardWeights = field(default_factory=RewardWeights)
