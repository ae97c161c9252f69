"""Parameters of policies: dataclasses of numbers, each with its limits, and the files that searches leave them in."""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from policies.base import PolicyError
from policies.shipped import models_folder
from quad_env.files.reading import parse_json, read_bytes
from quad_env.robots import similarity
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

Range = tuple[float, float]
STRIDE_FREQUENCY_EXPONENT = -0.14
"""Power of the mass with which animals' stride frequency goes where a trot becomes a gallop, 4.48 Hz for 1 kg (N. C.
Heglund, C. R. Taylor and T. A. McMahon, Scaling stride frequency and gait to animal size, 1974): 3.1 Hz for 14 kg. Legs
that are short for the mass, as go1's, step no faster."""
N = TypeVar("N", int, float, float | None)
P = TypeVar("P", bound="Parameters")
T = TypeVar("T")


def parameter(default: N, *, limits: Range, search: Range | None = None, unit: str = "") -> N:
    """A field: its default, what it must lie within, bounds within which a search of it makes sense, and its unit where
    it is another number for a larger robot, one of `quad_env.robots.similarity`."""
    return field(default=default, metadata={"limits": limits, "search": search, "unit": unit})


def limits_of(kind: Any) -> dict[str, Range]:
    """Limits of the numbers of a dataclass, by field name."""
    return {each.name: each.metadata["limits"] for each in fields(kind) if each.metadata}


def search_ranges_of(kind: Any) -> dict[str, Range]:
    """Bounds of a search of those numbers of a dataclass that have any, by field name."""
    return {each.name: each.metadata["search"] for each in fields(kind) if each.metadata and each.metadata["search"]}


@dataclass(frozen=True)
class Parameters:
    """Numbers whose limits are far beyond any use, but within them every action is a finite number; else ValueError."""

    def __post_init__(self) -> None:
        for name, (low, high) in limits_of(self).items():
            if not low <= (value := getattr(self, name)) <= high:  # nan lies nowhere
                raise ValueError(f"{name} must be finite, from {low:g} to {high:g}, not {float(value):g}")


@dataclass(frozen=True)
class CommandMap(Parameters):
    """What to ask of a gait so that the robot achieves its command; see `policies.gait_cycle.mapped`."""

    forward_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Gait's forward velocity per commanded."""
    forward_bias: float = parameter(0.0, limits=(-100.0, 100.0), unit="m/s ahead")
    """Added to the gait's forward velocity, m/s: all knees bend the same way, so that a gait in place drifts."""
    lateral_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Gait's lateral velocity per commanded."""
    yaw_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Gait's yaw rate per commanded."""
    yaw_per_lateral: float = parameter(0.0, limits=(-100.0, 100.0), unit="1/m ahead")
    """Added to the gait's yaw rate per commanded lateral velocity, rad/m: walking sideways turns the robot."""


def scaled_parameters(parameters: P, robot: Robot) -> P:
    """SimpleQuad's parameters for a robot, by dynamic similarity. Raises PolicyError for one of a size beyond any."""
    values = ((each.name, each.metadata["unit"], getattr(parameters, each.name)) for each in fields(parameters))
    try:
        return replace(
            parameters, **{name: similarity.scale_to_robot(robot, value, unit) for name, unit, value in values}
        )
    except ValueError as error:
        raise PolicyError(f"SimpleQuad's parameters are none for {robot.name}: {error}") from None


def scaled_ranges(ranges: Mapping[str, Range], kind: type[Parameters], robot: Robot) -> dict[str, Range]:
    """Bounds of a search of SimpleQuad's parameters of that kind, for a robot."""
    units = {each.name: each.metadata["unit"] for each in fields(kind)}
    ends = {
        name: [similarity.scale_to_robot(robot, end, units[name]) for end in bounds] for name, bounds in ranges.items()
    }
    if "frequency" in ranges:
        ends["frequency"] = [
            end * similarity.scale_to_robot(robot, 1.0, "kg") ** STRIDE_FREQUENCY_EXPONENT
            for end in ranges["frequency"]
        ]
    return {name: (min(both), max(both)) for name, both in ends.items()}


def from_json(kind: type[P], values: Any) -> P:
    """The parameters of a JSON object. Raises ValueError unless it holds a number for each and nothing else."""
    if not isinstance(values, dict):
        raise ValueError("parameters must be an object")
    if strange := values.keys() ^ {each.name for each in fields(kind)}:
        first, *more = map(repr, sorted(strange))
        names = f"{first} and {len(more)} more" if len(more) > 4 else ", ".join((first, *more))
        raise ValueError(f"parameters are not those of {kind.__name__}: {names} missing or unknown")
    if not all(is_number(value) for value in values.values()):
        raise ValueError("parameters must be finite numbers")
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"parameters are out of range ({error})") from None


def is_number(value: Any) -> bool:
    """Whether a JSON value is a number that a float can hold."""
    # Not math.isfinite, which fails on whole numbers of more digits than that.
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def read_parameters(path: Path, decode: Callable[[Any], T], search: str = "") -> T:
    """Parameters in a JSON file, decoded; `search` is the one that writes such a file. Raises PolicyError where it is
    missing or damaged."""
    try:
        return decode(parse_json(read_bytes(path)))
    except (AttributeError, KeyError, OSError, RecursionError, TypeError, ValueError) as error:
        remedy = f"`python -m train search {search}` writes such a file" if search else "restore the file as it shipped"
        raise PolicyError(f"cannot read {path} ({error})", remedy) from None


@dataclass(frozen=True)
class ParameterFile(Generic[P]):
    """A JSON file of parameters that a search writes."""

    path: Path
    """SimpleQuad's in force."""
    kind: type[P]
    search: str = ""
    """What follows `python -m train search` where that writes such a file."""

    def read(self, path: Path) -> P:
        """Parameters from a file like it; PolicyError where it is missing or damaged, or does not name them all."""
        return read_parameters(path, lambda values: from_json(self.kind, values), self.search)

    def load_for_robot(self, robot: Robot = SIMPLE_QUAD) -> P:
        """The robot's parameters: those of a file of that name in its own folder, with gains of other servos first in
        `soft_servos` there, or without one SimpleQuad's by dynamic similarity. PolicyError for a damaged file."""
        own = models_folder(robot) / self.path.name
        soft = own.parent / "soft_servos" / own.name
        own = soft if robot.servo_fixed and soft.is_file() else own
        return self.read(own) if own.is_file() else scaled_parameters(self.read(self.path), robot)
