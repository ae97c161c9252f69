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
"""Type of a range of numbers: (smallest, largest)."""
STRIDE_FREQUENCY_EXPONENT = -0.14
"""Exponent of the body mass in the stride frequency at which animals change from trot to gallop.

The stride frequency is 4.48 Hz for 1 kg (N. C. Heglund, C. R. Taylor and T. A. McMahon, Scaling stride frequency and
gait to animal size, 1974), and therefore 3.1 Hz for 14 kg. `scaled_ranges` uses this exponent, not the leg length, to
scale the search range of the gait frequency. A robot with legs that are short for its mass, such as go1, need not step
faster."""
N = TypeVar("N", int, float, float | None)
P = TypeVar("P", bound="Parameters")
T = TypeVar("T")


def parameter(default: N, *, limits: Range, search: Range | None = None, unit: str = "") -> N:
    """Make a dataclass field for a number with limits and, if a search tunes it, a search range.

    Args:
        default: Default value of the field.
        limits: Smallest and largest value that is accepted.
        search: Lower and upper bound in a parameter search; None if no search changes the field.
        unit: Unit of the number, one of the units in `quad_env.robots.similarity`. The unit determines how the number
            is scaled to a robot of another size. Empty for a dimensionless number.

    Returns:
        Dataclass field with the keys `limits`, `search` and `unit` in its metadata.
    """
    return field(default=default, metadata={"limits": limits, "search": search, "unit": unit})


def limits_of(kind: Any) -> dict[str, Range]:
    """Return the limits of the parameters in a dataclass `kind`: field name -> (smallest, largest)."""
    return {entry.name: entry.metadata["limits"] for entry in fields(kind) if entry.metadata}


def search_ranges_of(kind: Any) -> dict[str, Range]:
    """Return the search ranges of a dataclass `kind` of parameters: field name -> (lower, upper bound).

    Fields that have no search range are left out.
    """
    metadata = {entry.name: entry.metadata for entry in fields(kind)}
    return {name: values["search"] for name, values in metadata.items() if values and values["search"]}


@dataclass(frozen=True)
class Parameters:
    """Base class of the parameters of a policy: a dataclass of numbers, each with limits.

    The constructor raises ValueError if a number is outside of its limits. The limits are far wider than the range of
    useful numbers. The limits guarantee that every action of the policy is finite.
    """

    def __post_init__(self) -> None:
        for name, (low, high) in limits_of(self).items():
            if not low <= (value := getattr(self, name)) <= high:  # the comparison is also false for NaN
                raise ValueError(f"{name} must be finite, from {low:g} to {high:g}, not {float(value):g}")


@dataclass(frozen=True)
class CommandMap(Parameters):
    """Linear map from a velocity command to the gait input with which the robot moves at this velocity.

    The map compensates systematic velocity errors of an open-loop gait, see `map_command`.
    """

    forward_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Forward velocity input of the gait per commanded forward velocity, dimensionless."""
    forward_bias: float = parameter(0.0, limits=(-100.0, 100.0), unit="m/s ahead")
    """Offset that is added to the forward velocity input of the gait, m/s.

    The offset compensates the forward drift of a robot that steps in place. The robot drifts because all its knees bend
    in the same direction."""
    lateral_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Lateral velocity input of the gait per commanded lateral velocity, dimensionless."""
    yaw_gain: float = parameter(1.0, limits=(-100.0, 100.0))
    """Yaw rate input of the gait per commanded yaw rate, dimensionless."""
    yaw_per_lateral: float = parameter(0.0, limits=(-100.0, 100.0), unit="1/m ahead")
    """Yaw rate that is added to the gait input per commanded lateral velocity, rad/m.

    The term compensates the unwanted turning of the robot when it walks sideways."""


def scaled_parameters(parameters: P, robot: Robot) -> P:
    """Scale the policy parameters of the robot SimpleQuad to another robot by dynamic similarity.

    Lengths scale with the leg length, times with the square root of the leg length, and masses with the mass of the
    robot. The unit of a parameter determines its scale.

    Args:
        parameters: Parameters of the policy for SimpleQuad.
        robot: Robot to which the parameters are scaled.

    Returns:
        Parameters of the policy for `robot`.

    Raises:
        PolicyError: A scaled parameter is outside of its limits.
    """
    units = {entry.name: entry.metadata["unit"] for entry in fields(parameters)}
    scaled = {name: similarity.scale_to_robot(robot, getattr(parameters, name), unit) for name, unit in units.items()}
    try:
        return replace(parameters, **scaled)
    except ValueError as error:
        raise PolicyError(f"SimpleQuad's parameters are none for {robot.name}: {error}") from None


def scaled_ranges(ranges: Mapping[str, Range], kind: type[Parameters], robot: Robot) -> dict[str, Range]:
    """Scale the search ranges of policy parameters from SimpleQuad to another robot by dynamic similarity.

    Dynamic similarity scales lengths with the leg length, and times with the square root of the leg length. The range
    of the gait frequency is scaled with the mass of the robot instead, see `STRIDE_FREQUENCY_EXPONENT`.

    Args:
        ranges: Parameter name -> (lower, upper) bound for SimpleQuad.
        kind: Class of the parameters, which defines their units.
        robot: Robot to which the ranges are scaled.

    Returns:
        Parameter name -> (lower, upper) bound for `robot`.
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
    """Convert a JSON object to the parameters of a policy.

    Args:
        kind: Class of the parameters.
        values: JSON object with exactly one number for each field of the class.

    Returns:
        Parameters of the class `kind`.

    Raises:
        ValueError: A field is missing, unknown, not a number or out of range.
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
    """Return True if a JSON `value` is a finite number that a float can represent."""
    # math.isfinite is not used, because it raises OverflowError for integers that are too large for a float.
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def read_parameters(path: Path, decode: Callable[[Any], T], search: str = "") -> T:
    """Read the parameters of a policy from a JSON file.

    Args:
        path: JSON file to read.
        decode: Function that converts the JSON value of the file to parameters.
        search: Arguments of the command `python -m train search` that writes the file, for example `trot`. The error
            message shows this command. Empty if no command writes the file.

    Returns:
        Result of `decode`.

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
    """JSON file with the parameters of a policy for SimpleQuad; other robots can have a file of their own."""

    path: Path
    """Path of the file with the parameters for SimpleQuad.

    A file for another robot has the same name and is in the models folder of this robot, see `load_for_robot`."""
    kind: type[P]
    """Class of the parameters in the file."""
    search: str = ""
    """Arguments of the command `python -m train search` that writes the file, for example `trot`.

    Empty if no command writes the file."""

    def read(self, path: Path) -> P:
        """Read the parameters from the file `path`, for example the file of another robot.

        Raises PolicyError if the file is missing, damaged or incomplete.
        """
        return read_parameters(path, lambda values: from_json(self.kind, values), self.search)

    def load_for_robot(self, robot: Robot = SIMPLE_QUAD) -> P:
        """Load the parameters of the policy for a `robot`. Raises PolicyError if the file is damaged.

        The file has the same name as the file for SimpleQuad, and is in the models folder of the robot, see
        `models_folder`. For a robot with fixed servo gains (`Robot.servo_fixed`), a file in the subfolder `soft_servos`
        has priority. If the robot has no file, the parameters of SimpleQuad are scaled to the robot by dynamic
        similarity.
        """
        file = models_folder(robot) / self.path.name
        soft_servo_file = file.parent / "soft_servos" / file.name
        if robot.servo_fixed and soft_servo_file.is_file():
            file = soft_servo_file
        return self.read(file) if file.is_file() else scaled_parameters(self.read(self.path), robot)
