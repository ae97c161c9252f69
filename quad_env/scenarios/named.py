"""Scenarios as they are written: `steady`, `push`, its level `push:3`, a severity `push=42`, several
`payload=15+slope=10`, a user's terrain `hill.toml`; each on the hardware profile, `push+hardware`.

A scenario is never tuned to a policy. Write one with `dataclasses.replace` or the constructor and pass it to `make`.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from quad_env.config import CommandRanges
from quad_env.extensions import check_new
from quad_env.files.paths import missing_file
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
    "any of them with +scan_lost, +randomised, +hardware or several of these, in this order, at its end"
)
"""How scenarios without a name of their own are written."""
SEPARATOR, EQUALS = "+", "="
TERRAIN = ".toml"
"""End of the path of a user's terrain."""
LARGEST = 1e6
"""Severity beyond which no unit of an axis means anything."""
STEADY = Scenario("steady", commands=CommandRanges.straight(0.5))
"""Level ground, and 0.5 m/s straight ahead for every robot, where effort is compared. Of no axis."""
_LABELS = ("name", "axis", "severity", "severity_unit")
_MERGED_BY_FIELD = Scenario, CommandRanges, Ground, Motors
"""Of which axes may set different parts."""


@lru_cache(maxsize=32)
def scenarios_of(robot: Robot) -> dict[str, Scenario]:
    """The named scenarios: each axis at its nominal severity, as hard for the robot as for SimpleQuad, and `STEADY`."""
    return {name: axis.scenario(axis.nominal, name) for name, axis in axes_of(robot).items()} | {STEADY.name: STEADY}


SCENARIOS = scenarios_of(SIMPLE_QUAD)


def scenario(which: str | Scenario, robot: str | Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario of a name such as `push`, of a level such as `push:3`, of severities in physical units such as
    `push=42` or `payload=15+slope=10`, on a terrain of yours, `hill.toml`, any of them on the robot's hardware profile,
    `push+hardware`, or the scenario itself; ValueError lists the valid names.

    Names and levels are as hard for the robot as for SimpleQuad.
    """
    if isinstance(which, Scenario):
        return which
    found = find(which, get_robot(robot)) if isinstance(which, str) else None
    if found is None:
        if isinstance(which, str) and (missing := missing_file(which)) is not None:
            raise ValueError(missing)
        raise ValueError(
            f"unknown scenario {which!r}; valid: {', '.join(SCENARIOS)}, {SYNTAX_HELP}, or a quad_env.Scenario"
        )
    return found


def find(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario | None:
    """As `scenario`, but None where the name is that of no scenario and no axis."""
    plain, with_ending = split(name)
    if with_ending is not None:
        found = find(plain, robot)
        return found and with_ending(found, robot)
    if name.endswith(TERRAIN):
        return _on_terrain(Path(name), robot)
    if is_combination(name):
        return combined(name, robot)
    axis, colon, level = name.partition(":")
    if colon and (leveled := known_axis(axis)) is not None:
        if not level.isdecimal():
            valid = f"{axis}:1 to {axis}:{len(leveled.levels)}, {axis}:all where several may be named"
            raise ValueError(f"'{name}' is no level of {axis}; valid: {valid}")
        return leveled.for_robot(robot).level(int(level))
    named = SCENARIOS if robot == SIMPLE_QUAD else scenarios_of(robot)
    return named[name] if name in named else _extension_scenario(name, robot)


def _extension_scenario(name: str, robot: Robot) -> Scenario | None:
    """Return an extension's scenario of that name, or its axis of that name at the nominal severity; None without."""
    scenarios = extension_scenarios()
    if name in scenarios:
        return scaled(scenarios[name], robot)
    axis = extension_axes().get(name)
    return None if axis is None else axis.for_robot(robot).scenario(axis.for_robot(robot).nominal, name)


def extension_scenarios() -> dict[str, Scenario]:
    """Return the scenarios of extensions by name.

    Raises:
        ValueError: An entry is no scenario of its name, or has a built-in name.
    """
    scenarios = check_new("scenarios", SCENARIOS)
    for name, entry in scenarios.items():
        if not isinstance(entry, Scenario) or entry.name != name:
            raise ValueError(f"extension: scenarios {name}: expected a quad_env.Scenario of this name, got {entry!r}")
    return scenarios


def split(name: str) -> tuple[str, Callable[[Scenario, Robot], Scenario] | None]:
    """A name without its last ending, and what that makes of a robot's scenario; None where there is none."""
    end = next(filter(name.endswith, SUFFIXES), "")
    return name.removesuffix(end), SUFFIXES.get(end)


def _on_terrain(path: Path, robot: Robot) -> Scenario:
    """Undisturbed on a user's terrain, which is as large for every robot; named after its file."""
    if path.stem in SCENARIOS or ":" in path.stem or is_combination(path.stem):
        raise ValueError(f"{path}: a scenario of quad_env is written {path.stem}; call the file differently")
    return scaled(Scenario(path.stem, HeightField.from_toml(path)), robot)


def is_combination(name: str) -> bool:
    """Whether a name is written as severities; one of quad_env's scenarios, or of a user's, never is."""
    return EQUALS in name or SEPARATOR in name


def combined(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario of `axis=severity`, each in its axis's unit, joined by +; ValueError, one line, for what is none.

    Severities are as they are written for every robot; of what else they bring, such as commands, the robot has its
    own. One severity is a scenario of its axis. A combination is of no axis: it has no levels, and no severity but its
    name.
    """
    axes = known_axes(robot)
    parts = _parts(name, axes)
    names = [axis.name for axis, _ in parts]
    if twice := [each for each in dict.fromkeys(names) if names.count(each) > 1]:
        raise ValueError(f"{name}: {' and '.join(twice)} is given twice")
    written, alone = _written(parts), []
    for axis, severity in parts:
        try:
            alone.append(axis.scenario(severity, written))
        except ValueError as error:
            raise ValueError(f"{_written([(axis, severity)])}: {error}") from None
    return alone[0] if len(alone) == 1 else _combine(written, alone, robot)


def scaled_name(name: str, robot: Robot) -> str:
    """The name of what is as hard for a robot, to three digits, as the scenario of that name is for SimpleQuad."""
    plain, with_ending = split(name)
    if with_ending is not None:
        return scaled_name(plain, robot) + name.removeprefix(plain)
    if not is_combination(name):
        return name
    return _written(
        [
            (axis, float(f"{axis.scaled(severity, robot):.3g}"))
            for axis, severity in _parts(name, known_axes(SIMPLE_QUAD))
        ]
    )


def _written(parts: list[tuple[Axis, float]]) -> str:
    """As short as it can be read back exactly."""
    return SEPARATOR.join(f"{axis.name}{EQUALS}{repr(severity).removesuffix('.0')}" for axis, severity in parts)


def _parts(name: str, axes: dict[str, Axis]) -> list[tuple[Axis, float]]:
    """Axes and severities of a combination."""
    parts = []
    for text in name.split(SEPARATOR):
        axis, equals, written = (word.strip() for word in text.partition(EQUALS))
        if (end := SEPARATOR + text) in SUFFIXES:
            raise ValueError(f"{name}: {end} stands at the end, once, as in payload=15+slope=10{end}")
        if axis not in axes:
            raise ValueError(f"{name}: unknown axis {axis!r}; valid: {', '.join(axes)}, as in payload=15+slope=10")
        try:
            severity = float(written)
        except ValueError:
            nominal = f"{axis}{EQUALS}{axes[axis].nominal:g}"
            what = f"{written!r} is no number" if equals else f"{axis} needs a severity"
            raise ValueError(f"{name}: {what}; write {nominal} for {axes[axis].quantity}") from None
        if not 0 <= severity <= LARGEST:
            raise ValueError(f"{name}: {axes[axis].quantity} is a number from 0 to {LARGEST:g}, got {written}")
        parts.append((axes[axis], severity + 0.0))  # of −0, 0
    return parts


def _combine(name: str, parts: list[Scenario], robot: Robot) -> Scenario:
    """What each of them sets, in one scenario."""
    axes = known_axes(robot)
    # At any level of the axis: the severity may be that of no disturbance.
    given = [(part.axis, [part, *map(axes[part.axis].at, axes[part.axis].levels)]) for part in parts]
    whole: Scenario = _merge_changes(scaled(Scenario(name), robot), given, name)
    return whole


def _merge_changes(usual: Any, given: list[tuple[str, list[Any]]], name: str, what: str = "") -> Any:
    """What axes set of a usual setting, by axis its own value and those at its levels; of what has parts, each part."""
    if isinstance(usual, _MERGED_BY_FIELD):
        merged = {}
        for part in (field.name for field in fields(usual) if field.name not in _LABELS):
            values = [(axis, [getattr(value, part) for value in its]) for axis, its in given]
            merged[part] = _merge_changes(getattr(usual, part), values, name, f"{what} {part.replace('_', ' ')}")
        return replace(usual, **merged)
    setters = [(axis, its[0]) for axis, its in given if any(value != usual for value in its)]
    for axis, own in setters:
        if own != setters[0][1]:
            raise ValueError(f"{name}: {setters[0][0]} and {axis} set the{what} differently; leave one out")
    return setters[0][1] if setters else usual
