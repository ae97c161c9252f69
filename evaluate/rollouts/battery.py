"""The batteries: the scenarios that every policy runs on, and what a name on the command line stands for."""

import runpy
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from quad_env.files.paths import missing_file
from quad_env.files.reading import MAX_TEXT_SIZE, check_file
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES, Axis, axes_of, known_axis
from quad_env.scenarios.registry import (
    SCENARIOS,
    STEADY,
    SYNTAX_HELP,
    TERRAIN,
    find,
    is_combination,
    scenarios_of,
    split,
)
from quad_env.scenarios.scenario import Scenario, with_hardware_profile
from quad_env.serialisation import from_plain, to_json_values

NOMINAL = ("flat", "push", "rough")
"""What the quick battery begins with."""
QUICK_LEVELS: dict[str, tuple[int, ...]] = {"push": (4,), "rough": (4,)}
"""Levels in the quick battery, by axis."""
LEVELS_ABOVE_NOMINAL = 2
"""Levels of each axis that the default battery has beyond the nominal one: hard, and hardest."""
ALL = "all"
_FILE = ".py:"


BATTERIES: dict[str, Callable[[Robot], tuple[Scenario, ...]]] = {
    "quick": lambda robot: (
        *_battery(robot, lambda axis: QUICK_LEVELS.get(axis.name, ())),
        *_hardware_scenarios(robot)[:1],
    ),
    "default": lambda robot: (
        *_battery(
            robot, lambda axis: range(axis.nominal_level, axis.nominal_level + LEVELS_ABOVE_NOMINAL + 1), tuple(AXES)
        ),
        *_hardware_scenarios(robot),
    ),
    "full": lambda robot: _battery(robot, lambda axis: range(1, len(axis.levels) + 1), tuple(AXES)),
    ALL: lambda robot: tuple(scenarios_of(robot).values()),
}
"""Names that stand for several scenarios: a first look; every axis at its nominal severity and the next two levels, and
with the hardware profile at the level after the nominal one; every axis at every level; every axis at its nominal
severity."""
_VALID = (
    f"{', '.join((*SCENARIOS, *BATTERIES))}, {SYNTAX_HELP}, every level of an axis such as push:all, "
    "a file of yours such as my_file.py:NAME"
)


def resolve(names: tuple[str, ...], robot: Robot = SIMPLE_QUAD) -> tuple[Scenario, ...]:
    """A robot's scenarios of names as `push`, `push:3`, `push:all`, `payload=15+slope=10`, `full`, `file.py:NAME`;
    ValueError lists the valid ones."""
    if not names:
        raise ValueError(f"no scenario given; valid: {_VALID}")
    by_name = [(name, each) for name in names for each in _named(name, robot)]
    called = [each.name for _, each in by_name]
    for twice in dict.fromkeys(name for name in called if called.count(name) > 1):
        files = [name for name, each in by_name if each.name == twice]
        if len(set(files)) > 1 and all(map(is_file_reference, files)):
            raise ValueError(
                f"{len(files)} scenarios have the name {twice}: {', '.join(files)}; a scenario is called after its "
                "file or in it: give one of them another name"
            )
    if several := [name for name in dict.fromkeys(called) if called.count(name) > 1]:
        raise ValueError(f"a scenario is given twice: {' '.join(several)}")
    return tuple(each for _, each in by_name)


def resolve_single(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """A robot's scenario of that name; ValueError where there is none, or several."""
    found, *more = resolve((name,), robot)
    if more:
        raise ValueError(f"{name} is {1 + len(more)} scenarios: name one of them")
    return found


def is_file_reference(name: str) -> bool:
    """Whether a name stands for what a file of the user's makes."""
    return _FILE in name or split(split(name)[0])[0].endswith(TERRAIN)


def _named(name: str, robot: Robot) -> tuple[Scenario, ...]:
    if name in BATTERIES:
        return BATTERIES[name](robot)
    plain, with_ending = split(name)
    if with_ending is not None:
        made = (with_ending(each, robot) for each in _named(plain, robot))
        return tuple({each.name: each for each in made}.values())
    if _FILE in name:
        return _from_file(name)
    axis, colon, level = name.partition(":")
    if colon and level == ALL and (leveled := known_axis(axis)) is not None:
        return tuple(map(leveled.for_robot(robot).level, range(1, len(leveled.levels) + 1)))
    if (one := find(name, robot)) is None:
        raise ValueError(missing_file(name) or f"unknown scenario {name!r}; valid: {_VALID}")
    return (one,)


def _hardware_scenarios(robot: Robot) -> tuple[Scenario, ...]:
    """With the hardware profile: level ground, the steady walk, and every axis at the level after its nominal one."""
    levels = (axis.level(min(axis.nominal_level + 1, len(axis.levels))) for axis in axes_of(robot).values())
    return with_profile((scenarios_of(robot)[NOMINAL[0]], STEADY, *levels))


def with_profile(scenarios: Iterable[Scenario]) -> tuple[Scenario, ...]:
    """The scenarios with the robot's hardware profile, none twice."""
    return tuple({each.name: each for each in map(with_hardware_profile, scenarios)}.values())


def _battery(
    robot: Robot, levels: Callable[[Axis], Iterable[int]], nominal: tuple[str, ...] = NOMINAL
) -> tuple[Scenario, ...]:
    """A robot's nominal scenarios of those axes and those levels of each axis, none twice, and the steady walk."""
    chosen = [scenarios_of(robot)[name] for name in nominal]
    for axis in axes_of(robot).values():
        for level in levels(axis):
            new = axis.level(min(level, len(axis.levels)))
            if not any(replace(new, name=known.name) == known for known in chosen):
                chosen.append(new)
    return (*chosen, STEADY)


def _from_file(reference: str) -> tuple[Scenario, ...]:
    """The scenarios that `file.py:NAME` refers to; ValueError, one line, where there are none."""
    file, _, name = reference.rpartition(":")
    contents = _contents_of(Path(file))
    if name not in contents:
        known = [key for key, value in contents.items() if _scenarios(value)]
        raise ValueError(f"{file} has no {name!r}; its scenarios: {', '.join(known) or 'none'}")
    found = _scenarios(contents[name])
    if not found:
        raise ValueError(f"{name} in {file} must be a quad_env.Scenario or a tuple of them, not {contents[name]!r:.80}")
    for scenario in found:
        _check(scenario, file)
    return found


def _contents_of(file: Path) -> dict[str, Any]:
    """What the file defines."""
    if not file.is_file():
        raise ValueError(f"there is no file {file}")
    try:
        check_file(file, MAX_TEXT_SIZE)
        return runpy.run_path(str(file))
    except (Exception, SystemExit) as error:
        raise ValueError(f"{file} fails: {format_exception(error)}") from error


def _scenarios(value: Any) -> tuple[Scenario, ...]:
    """The scenarios that a value is; none if it is something else."""
    several = tuple(value) if isinstance(value, list | tuple) else (value,)
    return several if all(isinstance(each, Scenario) for each in several) else ()


def _check(scenario: Scenario, file: str) -> None:
    """Raise ValueError for a scenario that a result could not hold."""
    if not isinstance(scenario.name, str) or not scenario.name:
        raise ValueError(f"a scenario in {file} needs a name, not {scenario.name!r}")
    if scenario.name in SCENARIOS or ":" in scenario.name or is_combination(scenario.name):
        raise ValueError(f"a scenario in {file} is called {scenario.name!r}, as one of quad_env's; call it differently")
    try:
        same = from_plain(to_json_values(scenario)) == scenario
    except ValueError as error:
        raise ValueError(f"the scenario {scenario.name} in {file}: {error}") from error
    if not same:
        raise ValueError(f"the scenario {scenario.name} in {file} must be made of numbers and texts alone")
