"""Text list of all scenarios, severities and the syntax of names: `python -m quad_env scenarios`."""

from dataclasses import dataclass

from quad_env.robots.registry import parse_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import Axis, known_axes
from quad_env.scenarios.registry import STEADY, extension_scenarios

SYNTAX_EXAMPLES = {
    "push": "the nominal severity of the axis",
    "push:3": "the third of its levels",
    "push=42": "that severity, in the unit of the axis",
    "payload=15+slope=10": "several at once, joined by +",
    "hill.toml": "a terrain of yours, a picture or an array: docs/environment.md",
    "push:3+hardware": "any of them with the robot's hardware profile: motors, delays, sensors, estimator",
    "push:3+randomised": "any of them with domain randomisation: masses, friction, gains, delay drawn every episode",
    "rough:3+scan_lost": "any of them with a height scan that shows nothing; policies without one see no difference",
    "rough:3+scan_dropouts": "any of them with a height scan that fails at times, in all points or in a half of them",
    "push:all": "every level; only in python -m evaluate --scenarios, as the next two",
    "quick": "a battery of scenarios; so are default, full and all",
    "my_file.py:NAME": "a quad_env.Scenario of yours, in a file",
}
"""Example of a scenario name, one for each form of the syntax -> explanation of the example."""


@dataclass(frozen=True)
class RobotOptions:
    """Options of a command that prints information about a robot."""

    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS, or the path of its MJCF, URDF or TOML."""


def main(options: RobotOptions) -> int:
    """Print the list of scenarios for the robot in `options`, and return the exit code 0."""
    print(text(parse_robot(options.robot)))
    return 0


def text(robot: Robot = SIMPLE_QUAD) -> str:
    """Return a text that lists every scenario of `robot` and explains the syntax of scenario names."""
    lines = [f"for {robot.name}: name, its severity, the levels of its axis from mild to hard, and what happens"]
    for axis in known_axes(robot).values():
        lines += [axis_line(axis), *(f"  {'':13}{line}" for line in (axis.sentence, axis.note) if line)]
    lines += [f"  {STEADY.name:13}level ground, and 0.5 m/s straight ahead: where effort is compared"]
    lines += [f"  {name:13}of an installed extension" for name in extension_scenarios()]
    lines += ["", "where a scenario is asked for, write"]
    lines += [f"  {example:21}{meaning}" for example, meaning in SYNTAX_EXAMPLES.items()]
    return "\n".join(lines)


def axis_line(axis: Axis) -> str:
    """Return the line of the list for a disturbance `axis`: name, nominal severity, quantity and levels."""
    unit = f" {axis.unit}" if axis.unit not in ("", "°") else axis.unit
    levels = " ".join(f"{level:.4g}" for level in axis.levels)
    return f"  {axis.name:13}{f'{axis.nominal:.4g}{unit}':12}{axis.quantity}: {levels}"
