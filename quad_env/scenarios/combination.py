"""Combinations: severities of several axes at once, as in `payload=15+slope=10`; of one alone, as in `push=42`."""

from dataclasses import fields, is_dataclass, replace
from typing import Any

from quad_env.files.text import number
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES, Axis, axes_of
from quad_env.scenarios.scaling import scaled
from quad_env.scenarios.scenario import Scenario

BETWEEN, EQUALS = "+", "="
LARGEST = 1e6
"""Severity beyond which no unit of an axis means anything."""
_UNDISTURBED = Scenario("undisturbed")
_LABELS = ("name", "axis", "severity", "severity_unit")
Setting = tuple[str, ...]
"""Something that a scenario sets: a field, or a field and a part of it, as the friction of the ground."""


def is_combination(name: str) -> bool:
    """Whether a name is written as a combination; one of quad_env's scenarios, or of a user's, never is."""
    return EQUALS in name or BETWEEN in name


def combined(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario of `axis=severity`, each in its axis's unit, joined by +; ValueError, one line, for what is none.

    Severities are as they are written for every robot; of what else they bring, such as commands, the robot has its
    own. One severity is a scenario of its axis. A combination is of no axis: it has no levels, and no severity but its
    name.
    """
    axes = axes_of(robot)
    parts = [_part(text, name, axes) for text in name.split(BETWEEN)]
    names = [axis.name for axis, _ in parts]
    if twice := [each for each in dict.fromkeys(names) if names.count(each) > 1]:
        raise ValueError(f"{name}: {' and '.join(twice)} is given twice")
    written = BETWEEN.join(f"{axis.name}{EQUALS}{_number(severity)}" for axis, severity in parts)
    alone = [_scenario(axis, severity, written) for axis, severity in parts]
    return alone[0] if len(alone) == 1 else _together(written, alone, robot)


def scaled_name(name: str, robot: Robot) -> str:
    """The name of what is as hard for a robot, to three digits, as the scenario of that name is for SimpleQuad."""
    if not is_combination(name):
        return name
    parts = (_part(text, name, AXES) for text in name.split(BETWEEN))
    scaled_parts = ((axis.name, float(f"{axis.scaled(severity, robot):.3g}")) for axis, severity in parts)
    return BETWEEN.join(f"{axis}{EQUALS}{_number(severity)}" for axis, severity in scaled_parts)


def _part(text: str, name: str, axes: dict[str, Axis]) -> tuple[Axis, float]:
    """Axis and severity of `payload=15`."""
    axis, equals, written = (word.strip() for word in text.partition(EQUALS))
    if axis not in axes:
        raise ValueError(f"{name}: unknown axis {axis!r}; valid: {', '.join(axes)}, as in payload=15+slope=10")
    try:
        severity = number(written)
    except ValueError:
        nominal = f"{axis}{EQUALS}{axes[axis].nominal:g}"
        what = f"{written!r} is no number" if equals else f"{axis} needs a severity"
        raise ValueError(f"{name}: {what}; write {nominal} for {axes[axis].quantity}") from None
    if not 0 <= severity <= LARGEST:
        raise ValueError(f"{name}: {axes[axis].quantity} is a number from 0 to {LARGEST:g}, got {written}")
    return axes[axis], severity + 0.0  # of −0, 0


def _number(severity: float) -> str:
    """As short as it can be read back exactly."""
    return repr(severity).removesuffix(".0")


def _scenario(axis: Axis, severity: float, name: str) -> Scenario:
    try:
        return axis.scenario(severity, name)
    except ValueError as error:
        raise ValueError(f"{axis.name}{EQUALS}{_number(severity)}: {error}") from None


def _together(name: str, parts: list[Scenario], robot: Robot) -> Scenario:
    """What each of them sets, in one scenario."""
    setters: dict[Setting, Scenario] = {}
    found = undisturbed = scaled(_UNDISTURBED, robot)
    for part in parts:
        for setting in _settings_of(part, axes_of(robot)[part.axis], undisturbed):
            other = setters.setdefault(setting, part)
            if _value(other, setting) != _value(part, setting):
                what = " ".join(setting).replace("_", " ")
                raise ValueError(f"{name}: {other.axis} and {part.axis} set the {what} differently; leave one out")
    for setting, part in setters.items():
        found = _with(found, setting, _value(part, setting))
    return replace(found, name=name)


def _settings_of(part: Scenario, axis: Axis, undisturbed: Scenario) -> list[Setting]:
    """What its axis sets at this severity or at any of its levels: a severity may be that of no disturbance."""
    scenarios = [part, *map(axis.at, axis.levels)]
    return list(dict.fromkeys(setting for scenario in scenarios for setting in _changed(scenario, undisturbed)))


def _changed(scenario: Scenario, undisturbed: Scenario) -> list[Setting]:
    """What it sets otherwise than a scenario without disturbance."""
    found: list[Setting] = []
    for name in (field.name for field in fields(Scenario) if field.name not in _LABELS):
        value, usual = getattr(scenario, name), getattr(undisturbed, name)
        if is_dataclass(usual) and type(value) is type(usual):
            found += [
                (name, part.name) for part in fields(usual) if getattr(value, part.name) != getattr(usual, part.name)
            ]
        elif value != usual:
            found.append((name,))
    return found


def _value(scenario: Scenario, setting: Setting) -> Any:
    value: Any = scenario
    for name in setting:
        value = getattr(value, name)
    return value


def _with(scenario: Scenario, setting: Setting, value: Any) -> Scenario:
    """The scenario with that setting."""
    field, *part = setting
    whole = replace(getattr(scenario, field), **{part[0]: value}) if part else value
    return replace(scenario, **{field: whole})
