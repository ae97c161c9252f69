"""Registry of scenarios by name, and parser of scenario names.

A disturbance axis varies one disturbance. The severity is the strength of the disturbance in a physical unit. A
scenario name is one of:

- a built-in scenario, `steady`;
- an axis at its nominal severity, `push`;
- an axis at a numbered level, `push:3`;
- an axis at a severity, `push=42`;
- a combination of axes and severities, `payload=15+slope=10`;
- the TOML file of a user's terrain, `hill.toml`.

Any name may end with `+hardware`, `+randomised`, `+scan_lost` or `+scan_dropouts`.

No scenario is tuned to a policy. To write a scenario, use the constructor `Scenario` or `dataclasses.replace`, and pass
the scenario to `gym.make`.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from quad_env.config import CommandRanges
from quad_env.extensions import check_new
from quad_env.files.paths import missing_file_message
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import Axis, axes_of, extension_axes, known_axes, known_axis
from quad_env.scenarios.disturbances import Ground, Motors
from quad_env.scenarios.scenario import SUFFIXES, Scenario, scaled
from quad_env.scenarios.terrain import HeightField

__all__ = ["SCENARIOS", "Scenario", "scenario"]

SYNTAX_HELP = (
    "a level of an axis such as push:3, severities of axes such as push=42 or payload=15+slope=10, "
    "a terrain of yours such as hill.toml, "
    "any of them with +scan_dropouts, +scan_lost, +randomised, +hardware or several of these, in this order, at its end"
)
"""Explanation of the syntax of scenario names that are not in `SCENARIOS`, for errors and help texts."""
SEPARATOR = "+"
EQUALS = "="
TERRAIN = ".toml"
"""Suffix of the TOML file that describes a user's terrain."""
MAX_SEVERITY = 1e6
"""Upper limit of a severity (strength of a disturbance), in the unit of its disturbance axis.

The limit is far above any physical value.
"""
STEADY = Scenario("steady", commands=CommandRanges.straight(0.5))
"""Scenario in which the motor effort of policies, such as the cost of transport, is compared.

Every robot moves straight ahead on flat ground with 0.5 m/s. The scenario belongs to no disturbance axis.
"""
_LABELS = ("name", "axis", "severity", "severity_unit")
"""Names of the fields of `Scenario` that identify a scenario.

`_combine` sets these fields of a combination of scenarios, and does not take them from the combined scenarios.
"""
_MERGED_BY_FIELD = (Scenario, CommandRanges, Ground, Motors)
"""Classes of settings that a combination of disturbance axes merges field by field.

Two axes of a combination may then set different fields of the same object.
"""


@lru_cache(maxsize=32)
def scenarios_of(robot: Robot) -> dict[str, Scenario]:
    """Return the built-in scenarios of `robot`: name -> scenario.

    The dictionary has one scenario for each built-in disturbance axis, at the nominal severity of the axis, and the
    scenario `STEADY`.
    """
    return {name: axis.scenario(axis.nominal, name) for name, axis in axes_of(robot).items()} | {STEADY.name: STEADY}


SCENARIOS = scenarios_of(SIMPLE_QUAD)


def scenario(which: str | Scenario, robot: str | Robot = SIMPLE_QUAD) -> Scenario:
    """Return the scenario that a name describes.

    Args:
        which: Name of a scenario, or a scenario, which is returned unchanged. A name is a disturbance axis `push`, a
            level of an axis `push:3`, or a severity in physical units `push=42`. A name can also be a combination
            `payload=15+slope=10`, or the file of a user's terrain `hill.toml`. A name may end with a suffix, for
            example `push+hardware`.
        robot: Robot, or name of a robot. Scenarios of axes and levels are scaled, so that they are as hard for the
            robot as for SimpleQuad.

    Returns:
        The scenario for the robot.

    Raises:
        ValueError: The name is unknown; the message lists the valid names.
    """
    if isinstance(which, Scenario):
        return which
    result = find(which, get_robot(robot)) if isinstance(which, str) else None
    if result is not None:
        return result
    if isinstance(which, str) and (missing := missing_file_message(which)) is not None:
        raise ValueError(missing)
    raise ValueError(
        f"unknown scenario {which!r}; valid: {', '.join(SCENARIOS)}, {SYNTAX_HELP}, or a quad_env.Scenario"
    )


def find(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario | None:
    """Return the scenario that a name describes, or None if the name is unknown.

    Args:
        name: Name of a scenario in the syntax of the function `scenario`.
        robot: Robot of the scenario.

    Returns:
        The scenario; None if the name is neither a scenario nor a disturbance axis.

    Raises:
        ValueError: The name has an invalid level, severity, combination or terrain file.
    """
    base_name, apply_suffix = split(name)
    if apply_suffix is not None:
        base = find(base_name, robot)
        return base and apply_suffix(base, robot)
    if name.endswith(TERRAIN):
        return _terrain_scenario(Path(name), robot)
    if is_combination(name):
        return combined(name, robot)
    axis_name, colon, level = name.partition(":")
    if colon and (axis := known_axis(axis_name)) is not None:
        if not level.isdecimal():
            valid = f"{axis_name}:1 to {axis_name}:{len(axis.levels)}, {axis_name}:all where several may be named"
            raise ValueError(f"'{name}' is no level of {axis_name}; valid: {valid}")
        return axis.for_robot(robot).level(int(level))
    named = SCENARIOS if robot == SIMPLE_QUAD else scenarios_of(robot)
    return named[name] if name in named else _extension_scenario(name, robot)


def _extension_scenario(name: str, robot: Robot) -> Scenario | None:
    """Return the scenario `name` that an extension adds, scaled to `robot`; None if there is none.

    `name` may also be a disturbance axis that an extension adds. The result is then the scenario of this axis at its
    nominal severity.
    """
    scenarios = extension_scenarios()
    if name in scenarios:
        return scaled(scenarios[name], robot)
    axis = extension_axes().get(name)
    if axis is None:
        return None
    robot_axis = axis.for_robot(robot)
    return robot_axis.scenario(robot_axis.nominal, name)


def extension_scenarios() -> dict[str, Scenario]:
    """Return the scenarios that extensions add.

    Returns:
        Name -> scenario for SimpleQuad.

    Raises:
        ValueError: An object is not a `Scenario`, its `name` is not its key in the extension, or the name is built-in.
    """
    scenarios = check_new("scenarios", SCENARIOS)
    for name, entry in scenarios.items():
        if not isinstance(entry, Scenario) or entry.name != name:
            raise ValueError(f"extension: scenarios {name}: expected a quad_env.Scenario of this name, got {entry!r}")
    return scenarios


def split(name: str) -> tuple[str, Callable[[Scenario, Robot], Scenario] | None]:
    """Split the last suffix (`+hardware`, `+randomised`, `+scan_lost` or `+scan_dropouts`) off the name of a scenario.

    Args:
        name: Name of a scenario in the syntax of the function `scenario`.

    Returns:
        base_name: Name of the scenario without the suffix.
        apply_suffix: Function that takes a scenario and a robot, and returns the scenario with the settings of the
            suffix; None if the name has no suffix.
    """
    suffix = next(filter(name.endswith, SUFFIXES), "")
    return name.removesuffix(suffix), SUFFIXES.get(suffix)


def _terrain_scenario(path: Path, robot: Robot) -> Scenario:
    """Return the scenario on the user's terrain that the TOML file `path` describes.

    The scenario has the name of the file, and no disturbances. Its commands are scaled to the robot, but the terrain is
    not.
    """
    if path.stem in SCENARIOS or ":" in path.stem or is_combination(path.stem):
        raise ValueError(f"{path}: a scenario of quad_env is written {path.stem}; call the file differently")
    return scaled(Scenario(path.stem, HeightField.from_toml(path)), robot)


def is_combination(name: str) -> bool:
    """Return True if the scenario `name` contains `=` or `+`, as in `push=42` or `payload=15+slope=10`.

    Names of other scenarios must not contain these characters.
    """
    return EQUALS in name or SEPARATOR in name


def combined(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """Return the scenario of a name with axes and severities, such as `payload=15+slope=10`.

    Commands and all other settings are scaled to the robot, but the severities in the name are not. A name with one
    axis gives a scenario of this axis. A combination of several axes belongs to no axis.

    Args:
        name: Pairs `axis=severity` that are joined by +; each severity is in the unit of its axis.
        robot: Robot of the scenario.

    Returns:
        The scenario.

    Raises:
        ValueError: The name is invalid; the message is one line.
    """
    severities = _parse_severities(name, known_axes(robot))
    axis_names = [axis.name for axis, _ in severities]
    if repeated := [axis_name for axis_name in dict.fromkeys(axis_names) if axis_names.count(axis_name) > 1]:
        raise ValueError(f"{name}: {' and '.join(repeated)} is given twice")
    canonical_name = _format_severities(severities)
    parts = []
    for axis, severity in severities:
        try:
            parts.append(axis.scenario(severity, canonical_name))
        except ValueError as error:
            raise ValueError(f"{_format_severities([(axis, severity)])}: {error}") from None
    return parts[0] if len(parts) == 1 else _combine(canonical_name, parts, robot)


def scaled_name(name: str, robot: Robot) -> str:
    """Return the name of a scenario that is as hard for `robot` as the scenario `name` is for SimpleQuad.

    Severities in the name, for example 42 N·s in `push=42`, are scaled to the robot and rounded to three digits.

    Args:
        name: Name of a scenario for SimpleQuad.
        robot: Robot to scale the severities to.

    Returns:
        Name of the scenario for the robot.
    """
    base_name, apply_suffix = split(name)
    if apply_suffix is not None:
        return scaled_name(base_name, robot) + name.removeprefix(base_name)
    if not is_combination(name):
        return name
    severities = _parse_severities(name, known_axes(SIMPLE_QUAD))
    return _format_severities([(axis, float(f"{axis.scaled(severity, robot):.3g}")) for axis, severity in severities])


def _format_severities(severities: list[tuple[Axis, float]]) -> str:
    """Format pairs of disturbance axis and severity as a scenario name, for example `payload=15+slope=10`.

    The name has the smallest number of digits with which `_parse_severities` returns exactly these pairs.
    """
    return SEPARATOR.join(f"{axis.name}{EQUALS}{repr(severity).removesuffix('.0')}" for axis, severity in severities)


def _parse_severities(name: str, axes: dict[str, Axis]) -> list[tuple[Axis, float]]:
    """Parse a scenario name, for example `payload=15+slope=10`, to pairs of disturbance axis and severity.

    `axes` contains the known axes, name -> axis. ValueError is raised for an unknown axis or an invalid severity.
    """
    severities = []
    for part in name.split(SEPARATOR):
        axis_name, equals, number = (word.strip() for word in part.partition(EQUALS))
        if (suffix := SEPARATOR + part) in SUFFIXES:
            raise ValueError(f"{name}: {suffix} stands at the end, once, as in payload=15+slope=10{suffix}")
        if axis_name not in axes:
            raise ValueError(f"{name}: unknown axis {axis_name!r}; valid: {', '.join(axes)}, as in payload=15+slope=10")
        axis = axes[axis_name]
        severities.append((axis, _parse_severity(name, axis, number, has_number=bool(equals))))
    return severities


def _parse_severity(name: str, axis: Axis, number: str, *, has_number: bool) -> float:
    """Parse the severity of a disturbance axis in a scenario name; raise ValueError if it is invalid.

    `number` is the text of the severity. `name` is the whole scenario name, for the error message. `has_number` is
    False if there is no `=` after the axis in the name.
    """
    try:
        severity = float(number)
    except ValueError:
        fact = f"{number!r} is no number" if has_number else f"{axis.name} needs a severity"
        raise ValueError(f"{name}: {fact}; write {axis.name}{EQUALS}{axis.nominal:g} for {axis.quantity}") from None
    if not 0 <= severity <= MAX_SEVERITY:
        raise ValueError(f"{name}: {axis.quantity} is a number from 0 to {MAX_SEVERITY:g}, got {number}")
    return severity + 0.0  # Zero is added, because the number -0.0 must become 0.0.


@dataclass(frozen=True)
class _AxisSetting:
    """Value that one disturbance axis of a combination gives to one setting of the scenario.

    A setting is the scenario itself, one of its fields, or a field of a field, such as `ground.friction`.
    """

    axis: str
    """Name of the disturbance axis that gives the value to the setting."""
    value: Any
    """Value of the setting at the severity that the combination has on this axis."""
    level_values: list[Any]
    """Value of the setting at each level of the disturbance axis, from easy to hard."""

    def is_set(self, default: Any) -> bool:
        """Return True if the disturbance axis changes this setting from its `default`.

        The default is the value of the setting in a scenario without disturbances. The values at all levels are tested
        too, because the value at one severity may happen to equal the default.
        """
        return any(value != default for value in (self.value, *self.level_values))

    def of_field(self, name: str) -> "_AxisSetting":
        """Return the field `name` of this setting's value as a separate setting.

        The value of this setting must be an object with fields. In the new setting, `value` and `level_values` are the
        values of the field. The disturbance axis is the same.
        """
        level_values = [getattr(value, name) for value in self.level_values]
        return _AxisSetting(self.axis, getattr(self.value, name), level_values)


def _combine(name: str, parts: list[Scenario], robot: Robot) -> Scenario:
    """Combine `parts`, one scenario of each disturbance axis, to one scenario for `robot` called `name`."""
    axes = known_axes(robot)
    settings = []
    for part in parts:
        axis = axes[part.axis]
        settings.append(_AxisSetting(part.axis, part, [axis.at(level) for level in axis.levels]))
    combination: Scenario = _merge(scaled(Scenario(name), robot), settings, name)
    return combination


def _merge(default: Any, settings: list[_AxisSetting], name: str, path: str = "") -> Any:
    """Merge the values that the disturbance axes of a combination give to one setting of the scenario.

    Objects of the classes `_MERGED_BY_FIELD` are merged field by field. In all other cases at most one axis may change
    the setting, unless the values are equal.

    Args:
        default: Value of the setting in a scenario without disturbances.
        settings: Values that each of the disturbance axes gives to the setting.
        name: Name of the combination, for error messages.
        path: Name of the setting for error messages, such as " ground friction"; empty for the whole scenario.

    Returns:
        Value of the setting in the combination.

    Raises:
        ValueError: Two axes change the setting to different values.
    """
    if isinstance(default, _MERGED_BY_FIELD):
        merged = {}
        for field in fields(default):
            if field.name not in _LABELS:
                field_settings = [setting.of_field(field.name) for setting in settings]
                field_path = f"{path} {field.name.replace('_', ' ')}"
                merged[field.name] = _merge(getattr(default, field.name), field_settings, name, field_path)
        return replace(default, **merged)
    setters = [setting for setting in settings if setting.is_set(default)]
    if not setters:
        return default
    first = setters[0]
    for other in setters:
        if other.value != first.value:
            raise ValueError(f"{name}: {first.axis} and {other.axis} set the{path} differently; leave one out")
    return first.value
