"""Batteries (named lists of scenarios), and selection of scenarios by names on the command line."""

import runpy
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from quad_env.files.paths import missing_file_message
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
from quad_env.serialisation import from_json_values, to_json_values

NOMINAL = "flat"
"""Name of the scenario of level ground without a disturbance, on which the battery `default` has both worlds."""
QUICK_LEVELS = {
    "flat": 2,
    "push": 3,
    "rough": 2,
    "force": 2,
    "slope": 5,
    "stairs": 3,
    "gravel": 2,
    "soft": 3,
    "slippery": 2,
    "payload": 4,
    "weak_motors": 3,
    "slow_motors": 3,
    "latency": 4,
    "noise": 4,
    "dropout": 4,
    "surprise": 3,
    "slow": 2,
}
"""Name of a disturbance axis -> number of its severity level in the battery `quick`; level 1 is the mildest.

It is the level of the battery `default` that separates the policies most, by `python -m research severities`, which
uses other episodes than an evaluation. The axis `flat` has its nominal level, on which `document` runs. An axis that
was not measured has the level after the nominal one.
"""
LEVELS_ABOVE_NOMINAL = 2
"""Number of severity levels above the nominal level that the battery `default` has on each disturbance axis.

The nominal level is the severity of the scenario that has the name of the axis, for example `push`.
"""
ALL = "all"
"""Name of the battery (list) of all scenarios at their nominal severity.

In a scenario name such as `push:all`, it selects all severity levels of the disturbance axis `push`.
"""
_FILE_SEPARATOR = ".py:"
"""Text between the name of a Python file and a variable in the file, as in `file.py:NAME`."""


BATTERIES: dict[str, Callable[[Robot], tuple[Scenario, ...]]] = {
    "quick": lambda robot: _quick_battery(robot),
    "default": lambda robot: (
        *_battery(robot, lambda axis: range(axis.nominal_level, axis.nominal_level + LEVELS_ABOVE_NOMINAL + 1)),
        *_hardware_scenarios(robot),
    ),
    "full": lambda robot: _battery(robot, lambda axis: range(1, len(axis.levels) + 1)),
    ALL: lambda robot: tuple(scenarios_of(robot).values()),
}
"""Name of a battery -> function that receives a robot and returns the scenarios of the battery.

The nominal severity level of a disturbance axis is the level of the scenario with its name, for example `push`.

- quick: every disturbance axis at the severity level that separates the policies most, with the hardware profile
  (models of the real robot's motors and sensors) and without it.
- default: every disturbance axis at its nominal severity level and the next two levels. With the hardware profile,
  every axis at one level above nominal.
- full: every disturbance axis at every severity level.
- all: every disturbance axis at its nominal severity level.
"""
_VALID = (
    f"{', '.join((*SCENARIOS, *BATTERIES))}, {SYNTAX_HELP}, every level of an axis such as push:all, "
    "a file of yours such as my_file.py:NAME"
)


def resolve(names: tuple[str, ...], robot: Robot = SIMPLE_QUAD) -> tuple[Scenario, ...]:
    """Return the scenarios that names on the command line select.

    Examples of valid names are `push`, `push:3` (severity level 3), `push:all`, `payload=15+slope=10`, `full` (a
    battery) and `file.py:NAME`.

    Args:
        names: Names on the command line.
        robot: Robot of the scenarios; severities are scaled to its size.

    Returns:
        Scenarios in the order of the names.

    Raises:
        ValueError: No name is given, a name is unknown, or a scenario is given twice.
    """
    if not names:
        raise ValueError(f"no scenario given; valid: {_VALID}")
    named = [(name, scenario) for name in names for scenario in _named(name, robot)]
    scenario_names = [scenario.name for _, scenario in named]
    repeated = [name for name in dict.fromkeys(scenario_names) if scenario_names.count(name) > 1]
    for scenario_name in repeated:
        sources = [name for name, scenario in named if scenario.name == scenario_name]
        if len(set(sources)) > 1 and all(map(is_file_reference, sources)):
            raise ValueError(
                f"{len(sources)} scenarios have the name {scenario_name}: {', '.join(sources)}; a scenario is called "
                "after its file or in it: give one of them another name"
            )
    if repeated:
        raise ValueError(f"a scenario is given twice: {' '.join(repeated)}")
    return tuple(scenario for _, scenario in named)


def resolve_single(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """Return the one scenario that a name on the command line selects.

    Args:
        name: Name on the command line.
        robot: Robot of the scenario; the severity is scaled to its size.

    Returns:
        The scenario.

    Raises:
        ValueError: The name is unknown, or it selects several scenarios.
    """
    first, *others = resolve((name,), robot)
    if others:
        raise ValueError(f"{name} is {1 + len(others)} scenarios: name one of them")
    return first


def is_file_reference(name: str) -> bool:
    """Return True if a scenario name refers to a user's file: `file.py:NAME` or a terrain file."""
    return _FILE_SEPARATOR in name or split(split(name)[0])[0].endswith(TERRAIN)


def _named(name: str, robot: Robot) -> tuple[Scenario, ...]:
    """Return the scenarios that one name on the command line selects.

    Args:
        name: Name of a scenario, battery or file.
        robot: Robot; severities are scaled to its size.

    Returns:
        The scenarios.

    Raises:
        ValueError: The name is unknown; the message lists the valid names.
    """
    if name in BATTERIES:
        return BATTERIES[name](robot)
    plain, with_ending = split(name)
    if with_ending is not None:
        ended = (with_ending(scenario, robot) for scenario in _named(plain, robot))
        return tuple({scenario.name: scenario for scenario in ended}.values())
    if _FILE_SEPARATOR in name:
        return _from_file(name)
    axis_name, colon, level = name.partition(":")
    if colon and level == ALL and (axis := known_axis(axis_name)) is not None:
        return tuple(map(axis.for_robot(robot).level, range(1, len(axis.levels) + 1)))
    scenario = find(name, robot)
    if scenario is None:
        raise ValueError(missing_file_message(name) or f"unknown scenario {name!r}; valid: {_VALID}")
    return (scenario,)


def _hardware_scenarios(robot: Robot) -> tuple[Scenario, ...]:
    """Return the scenarios with the hardware profile in the battery `default`, scaled to the `robot`.

    They are `flat`, `steady`, and one scenario of each disturbance axis: the severity level above the nominal level.
    """
    levels = (axis.level(min(axis.nominal_level + 1, len(axis.levels))) for axis in axes_of(robot).values())
    return with_profile((scenarios_of(robot)[NOMINAL], STEADY, *levels))


def with_profile(scenarios: Iterable[Scenario]) -> tuple[Scenario, ...]:
    """Return the `scenarios`, changed to the hardware profile (models of real motors, sensors and delays).

    If two changed scenarios have the same name, only one of them is returned.
    """
    return tuple({scenario.name: scenario for scenario in map(with_hardware_profile, scenarios)}.values())


def _quick_battery(robot: Robot) -> tuple[Scenario, ...]:
    """Return the battery `quick`, scaled to the `robot`: the levels in QUICK_LEVELS, in both worlds, and `steady`.

    The nominal level has the name of the axis, as in the other batteries.
    """
    nominal = scenarios_of(robot)
    chosen = [
        nominal[axis.name] if QUICK_LEVELS[axis.name] == axis.nominal_level else axis.level(QUICK_LEVELS[axis.name])
        for axis in axes_of(robot).values()
    ]
    return (*chosen, STEADY, *with_profile(chosen))


def _battery(robot: Robot, levels: Callable[[Axis], Iterable[int]]) -> tuple[Scenario, ...]:
    """Return a battery: nominal scenarios and severity levels of each disturbance axis, and `steady`.

    Scenarios that differ only in their names are returned only once.

    Args:
        robot: Robot of the scenarios; severities are scaled to its size.
        levels: Function that receives a disturbance axis and returns the numbers of its levels in the battery, from 1.

    Returns:
        Scenarios in the order of the battery.
    """
    chosen = [scenarios_of(robot)[name] for name in AXES]
    for axis in axes_of(robot).values():
        for level in levels(axis):
            new = axis.level(min(level, len(axis.levels)))
            if not any(replace(new, name=known.name) == known for known in chosen):
                chosen.append(new)
    return (*chosen, STEADY)


def _from_file(reference: str) -> tuple[Scenario, ...]:
    """Return the scenarios that the variable in a `reference` such as `file.py:NAME` contains.

    ValueError is raised if the variable does not exist or contains no scenarios.
    """
    file, _, name = reference.rpartition(":")
    contents = _run_file(Path(file))
    if name not in contents:
        known = [key for key, value in contents.items() if _as_scenarios(value)]
        raise ValueError(f"{file} has no {name!r}; its scenarios: {', '.join(known) or 'none'}")
    scenarios = _as_scenarios(contents[name])
    if not scenarios:
        raise ValueError(f"{name} in {file} must be a quad_env.Scenario or a tuple of them, not {contents[name]!r:.80}")
    for scenario in scenarios:
        _check(scenario, file)
    return scenarios


def _run_file(file: Path) -> dict[str, Any]:
    """Run a user's Python `file`, and return its global variables: name -> value.

    ValueError is raised if the file does not exist or fails.
    """
    if not file.is_file():
        raise ValueError(f"there is no file {file}")
    try:
        check_file(file, MAX_TEXT_SIZE)
        return runpy.run_path(str(file))
    except (Exception, SystemExit) as error:
        raise ValueError(f"{file} fails: {format_exception(error)}") from error


def _as_scenarios(value: Any) -> tuple[Scenario, ...]:
    """Convert a scenario, or a list or tuple of scenarios, to a tuple; return () for any other `value`."""
    scenarios = tuple(value) if isinstance(value, list | tuple) else (value,)
    return scenarios if all(isinstance(scenario, Scenario) for scenario in scenarios) else ()


def _check(scenario: Scenario, file: str) -> None:
    """Check that a scenario from a user's file has an allowed name and can be stored with the results.

    Args:
        scenario: Scenario to check.
        file: Name of the file, for the error message.

    Raises:
        ValueError: The name is missing or not allowed, or the scenario contains values other than numbers and texts.
    """
    if not isinstance(scenario.name, str) or not scenario.name:
        raise ValueError(f"a scenario in {file} needs a name, not {scenario.name!r}")
    if scenario.name in SCENARIOS or ":" in scenario.name or is_combination(scenario.name):
        raise ValueError(f"a scenario in {file} is called {scenario.name!r}, as one of quad_env's; call it differently")
    try:
        is_restored = from_json_values(to_json_values(scenario)) == scenario
    except ValueError as error:
        raise ValueError(f"the scenario {scenario.name} in {file}: {error}") from error
    if not is_restored:
        raise ValueError(f"the scenario {scenario.name} in {file} must be made of numbers and texts alone")
