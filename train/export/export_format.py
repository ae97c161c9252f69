"""A deployment format: its files, its writer, and the checks that all writers share."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from policies.base import Floats, PolicyError
from policies.external.packages import import_package
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario, scaled
from train.export.plain_network import PlainNetwork

CLOCK_FORMATS = "formats with a clock: unitree, isaac-lab, toml"
"""Note on the formats that can describe a policy with a gait clock."""
CANNOT_SAY = "the format cannot say it"
"""Reason why a format cannot describe a property of a network, if nothing more exact is known."""
PHYSICS_PERIOD = 0.005
"""s. Physics step of Isaac Lab's velocity tasks, and period of rl_sar's servo loop."""


@dataclass(frozen=True)
class ExportFormat:
    """Format of the deployment files of a project.

    `write` writes the files of a network into an empty folder and returns the network as written. It raises PolicyError
    for a network that the format cannot describe.
    """

    name: str
    """Name of the format, the value of `--to`."""
    summary: str
    """The files and the programs that read them, one line."""
    settings: str
    """Path of the file with the settings, relative to the folder of the export; the readers of policies read it."""
    onnx: str
    """Path of the network as ONNX, relative to the folder of the export."""
    usage: str
    """Steps that run the export in its project, one line; `{robot}` stands for the name of the robot."""
    write: Callable[[PlainNetwork, Path], PlainNetwork]
    describes_all: bool = False
    """True if the format has past values at any age, averages, position errors and clocks of variable frequency."""


def check_terms(
    network: PlainNetwork,
    names: Mapping[str, str],
    format_name: str,
    reasons: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Raise PolicyError for the first observation term that a format does not have.

    Args:
        network: Plain network.
        names: Name of a term of this project -> name in the format.
        format_name: Name of the format, for the message.
        reasons: Name of a term -> reason why the programs of the format do not have it.
    """
    for term in network.spec.terms:
        if term.name not in names:
            valid = ", ".join(names)
            if term.name == "gait_clock":
                valid += f"; {CLOCK_FORMATS}"
            raise_unsupported(format_name, "observation term", term.name, valid, reasons.get(term.name, CANNOT_SAY))
        if term.zero_below:
            raise_unsupported(format_name, "clock at rest (clock_at_rest)", "hidden", "shown")


def raise_unsupported(format_name: str, name: str, value: Any, valid: str, reason: str = CANNOT_SAY) -> None:
    """Raise PolicyError because a format cannot describe a property of a network.

    Args:
        format_name: Name of the format.
        name: Name of the property.
        value: Value of the property.
        valid: Values that the format can describe.
        reason: Reason, as a clause.

    Raises:
        PolicyError: Always.
    """
    raise PolicyError(f"--to {format_name}: {name}: {reason}, got {value}; valid: {valid}")


def decimation_of(network: PlainNetwork) -> int:
    """Return the number of physics steps in a control step, for a physics step close to PHYSICS_PERIOD."""
    return max(round(1.0 / network.spec.control_rate / PHYSICS_PERIOD), 1)


def command_ranges(robot: Robot) -> dict[str, list[float]]:
    """Return the ranges of the velocity commands of a robot under the keys of Isaac Lab, m/s and rad/s."""
    commands = scaled(Scenario("default"), robot).commands
    return {
        "lin_vel_x": list(commands.forward),
        "lin_vel_y": list(commands.lateral),
        "ang_vel_z": list(commands.yaw_rate),
    }


def to_list(values: Floats) -> list[float]:
    """Return an array, (n,), as a list of Python numbers."""
    return [float(value) for value in values]


def write_yaml(settings: Mapping[str, Any], file: Path) -> None:
    """Write settings to a YAML file, with each list of numbers in one line; the folder is made if it is missing."""
    yaml = import_package("yaml")
    file.parent.mkdir(parents=True, exist_ok=True)
    text = yaml.safe_dump(dict(settings), sort_keys=False, default_flow_style=None, width=1000)
    file.write_text(text, encoding="utf-8")
