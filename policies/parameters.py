"""Parameters of policies: dataclasses of numbers with limits, and the JSON files that store them."""

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
"""Exponent of the body mass in the stride frequency at which animals change from trot to gallop.

This frequency is 4.48 Hz for 1 kg (N. C. Heglund, C. R. Taylor and T. A. McMahon, Scaling stride frequency and gait to
animal size, 1974), and therefore 3.1 Hz for 14 kg. Legs that are short for the mass, as on go1, do not step faster."""
N = TypeVar("N", int, float, float | None)
P = TypeVar("P", bound="Parameters")
T = TypeVar("T")


def parameter(default: N, *, limits: Range, search: Range | None = None, unit: str = "") -> N:
    """Make a dataclass field with limits and a search range.

    Args:
        default: Default value.
        limits: Smallest and largest value.
        search: Bounds of a search; None if it is not searched.
        unit: Unit of `quad_env.robots.similarity` if the value scales with the size of the robot.

    Returns:
        The field.
    """
    return field(default=default, metadata={"limits": limits, "search": search, "unit": unit})


def limits_of(kind: Any) -> dict[str, Range]:
    """Return the dictionary field name -> (smallest, largest) value, for a dataclass of parameters."""
    return {entry.name: entry.metadata["limits"] for entry in fields(kind) if entry.metadata}


def search_ranges_of(kind: Any) -> dict[str, Range]:
    """Return the dictionary field name -> search range, for the fields of a dataclass that have one."""
    metadata = {entry.name: entry.metadata for entry in fields(kind)}
    return {name: values["search"] for name, values in metadata.items() if values and values["search"]}


@dataclass(frozen=True)
class Parameters:
    """Base class of parameters; a number outside of its limits raises ValueError.

    The limits are far wider than useful values. Every action is finite if all numbers are within their limits.
    """

    def __post_init__(self) -> None:
        for name, (low, high) in limits_of(self).items():
            if not low <= (value := getattr(self, name)) <= high:  # NaN fails this comparison, too
                raise ValueError(f"{name} must be finite, from {low:g} to {high:g}, not {float(value):g}")


@dataclass(frozen=True)
class CommandMap(Parameters):
    """Map from a command to the gait input at which the robot achieves it, see `map_command`."""

    forward_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Forward velocity of the gait per commanded velocity."""
    forward_bias: float = parameter(0.0, limits=(-100.0, 100.0), unit="m/s ahead")
    """Offset added to the forward velocity of the gait, m/s.

    The offset compensates the drift of a gait in place, which occurs because all knees bend the same way."""
    lateral_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Lateral velocity of the gait per commanded velocity."""
    yaw_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Yaw rate of the gait per commanded yaw rate."""
    yaw_per_lateral: float = parameter(0.0, limits=(-100.0, 100.0), unit="1/m ahead")
    """Yaw rate added to the gait per commanded lateral velocity, rad/m, because walking sideways turns the robot."""


def scaled_parameters(parameters: P, robot: Robot) -> P:
    """Scale SimpleQuad's parameters to a robot by dynamic similarity.

    Args:
        parameters: Parameters of SimpleQuad.
        robot: Robot.

    Returns:
        Parameters of the robot.

    Raises:
        PolicyError: The scaled parameters exceed their limits.
    """
    units = {entry.name: entry.metadata["unit"] for entry in fields(parameters)}
    scaled = {name: similarity.scale_to_robot(robot, getattr(parameters, name), unit) for name, unit in units.items()}
    try:
        return replace(parameters, **scaled)
    except ValueError as error:
        raise PolicyError(f"SimpleQuad's parameters are none for {robot.name}: {error}") from None


def scaled_ranges(ranges: Mapping[str, Range], kind: type[Parameters], robot: Robot) -> dict[str, Range]:
    """Scale the search ranges of SimpleQuad's parameters to a robot.

    Args:
        ranges: Field name -> bounds for SimpleQuad.
        kind: Class of the parameters.
        robot: Robot.

    Returns:
        Field name -> bounds for the robot.
    """
    units = {entry.name: entry.metadata["unit"] for entry in fields(kind)}
    ends = {
        name: [similarity.scale_to_robot(robot, end, units[name]) for end in bounds] for name, bounds in ranges.items()
    }
    if "frequency" in ranges:
        ends["frequency"] = [
            end * similarity.scale_to_robot(robot, 1.0, "kg") ** STRIDE_FREQUENCY_EXPONENT
            for end in ranges["frequency"]
        ]
    return {name: (min(pair), max(pair)) for name, pair in ends.items()}


def from_json(kind: type[P], values: Any) -> P:
    """Convert a JSON object to parameters.

    Args:
        kind: Class of the parameters.
        values: JSON object with a number for each field and nothing else.

    Returns:
        The parameters.

    Raises:
        ValueError: Values are missing, unknown or out of range.
    """
    if not isinstance(values, dict):
        raise ValueError("parameters must be an object")
    if different := values.keys() ^ {entry.name for entry in fields(kind)}:
        first, *more = map(repr, sorted(different))
        names = f"{first} and {len(more)} more" if len(more) > 4 else ", ".join((first, *more))
        raise ValueError(f"parameters are not those of {kind.__name__}: {names} missing or unknown")
    if not all(is_number(value) for value in values.values()):
        raise ValueError("parameters must be finite numbers")
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"parameters are out of range ({error})") from None


def is_number(value: Any) -> bool:
    """Return True if a JSON value is a number that a float can hold."""
    # Not math.isfinite, which fails on integers that are too large for a float.
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def read_parameters(path: Path, decode: Callable[[Any], T], search: str = "") -> T:
    """Read parameters from a JSON file.

    Args:
        path: File.
        decode: Converts the JSON value to parameters.
        search: Words after `python -m train search` of the command that writes the file, for the error.

    Returns:
        The parameters.

    Raises:
        PolicyError: The file is missing or damaged.
    """
    try:
        return decode(parse_json(read_bytes(path)))
    except (AttributeError, KeyError, OSError, RecursionError, TypeError, ValueError) as error:
        remedy = f"`python -m train search {search}` writes such a file" if search else "restore the file as it shipped"
        raise PolicyError(f"cannot read {path} ({error})", remedy) from None


@dataclass(frozen=True)
class ParameterFile(Generic[P]):
    """JSON file of parameters, which a search writes."""

    path: Path
    """File of SimpleQuad's parameters. Files of other robots have the same name."""
    kind: type[P]
    """Class of the parameters."""
    search: str = ""
    """Words after `python -m train search` of the command that writes the file; empty if no command does."""

    def read(self, path: Path) -> P:
        """Read parameters from another file. Raises PolicyError if it is missing, damaged or incomplete."""
        return read_parameters(path, lambda values: from_json(self.kind, values), self.search)

    def load_for_robot(self, robot: Robot = SIMPLE_QUAD) -> P:
        """Load the parameters of a robot. Raises PolicyError if the file is damaged.

        The file of a robot has the name of `path` and lies in the folder of the robot. For a robot with fixed servos a
        file in the subfolder `soft_servos` has priority. If there is no file, the method scales the parameters of
        SimpleQuad by dynamic similarity.
        """
        file = models_folder(robot) / self.path.name
        soft_servo_file = file.parent / "soft_servos" / file.name
        if robot.servo_fixed and soft_servo_file.is_file():
            file = soft_servo_file
        return self.read(file) if file.is_file() else scaled_parameters(self.read(self.path), robot)
