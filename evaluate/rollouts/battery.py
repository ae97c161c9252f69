"""The batteries: the scenarios that every policy is judged on, and what a name on the command line stands for."""

from collections.abc import Callable
from dataclasses import replace
from itertools import chain

from evaluate.rollouts.scenario_file import from_file
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.combination import combined, is_combination
from quad_env.scenarios.named import SCENARIOS, Scenario, scenario

NOMINAL = ("flat", "push", "rough")
"""What the quick battery begins with."""
QUICK_LEVELS: dict[str, tuple[int, ...]] = {"push": (4,), "rough": (4,)}
"""Levels in the quick battery, by axis."""
HARDER = 2
"""Levels of each axis that the default battery has beyond the nominal one: hard, and hardest."""
ALL = "all"
_FILE = ".py:"


BATTERIES: dict[str, Callable[[], tuple[Scenario, ...]]] = {
    "quick": lambda: _battery(lambda axis: QUICK_LEVELS.get(axis, ())),
    "default": lambda: _battery(_nominal_and_harder, tuple(AXES)),
    "full": lambda: _battery(lambda axis: tuple(range(1, len(AXES[axis].levels) + 1)), tuple(AXES)),
    ALL: lambda: tuple(SCENARIOS.values()),
}
"""Names that stand for several scenarios: a first look; every axis at its nominal severity and the next two levels;
every axis at every level; every axis at its nominal severity."""


def resolve(names: tuple[str, ...]) -> tuple[Scenario, ...]:
    """Scenarios of names as `push`, `push:3`, `push:all`, `payload=15+slope=10`, `full`, `file.py:NAME`; ValueError
    lists the valid ones."""
    if not names:
        raise ValueError(f"no scenario given; valid: {_valid()}")
    found = tuple(chain.from_iterable(map(_named, names)))
    called = [each.name for each in found]
    if twice := [name for name in dict.fromkeys(called) if called.count(name) > 1]:
        raise ValueError(f"a scenario is given twice: {' '.join(twice)}")
    return found


def _named(name: str) -> tuple[Scenario, ...]:
    if name in BATTERIES:
        return BATTERIES[name]()
    if _FILE in name:
        return from_file(name)
    if is_combination(name):
        return (combined(name),)
    axis, colon, level = name.partition(":")
    if colon and axis in AXES:
        if level == ALL:
            return tuple(map(AXES[axis].level, range(1, len(AXES[axis].levels) + 1)))
        if level.isdecimal():
            return (AXES[axis].level(int(level)),)
        raise ValueError(
            f"{name!r} is no level of {axis}; valid: {axis}:1 to {axis}:{len(AXES[axis].levels)}, {axis}:{ALL}"
        )
    if name not in SCENARIOS:
        raise ValueError(f"unknown scenario {name!r}; valid: {_valid()}")
    return (scenario(name),)


def _valid() -> str:
    levels = (
        "a level of an axis such as push:3 or push:all, severities such as payload=15+slope=10, "
        "a file of yours such as my_file.py:NAME"
    )
    return f"{', '.join((*SCENARIOS, *BATTERIES))}, {levels}"


def _nominal_and_harder(axis: str) -> tuple[int, ...]:
    """Levels of the default battery."""
    nominal = AXES[axis].levels.index(AXES[axis].nominal) + 1
    return tuple(range(nominal, nominal + HARDER + 1))


def _battery(levels: Callable[[str], tuple[int, ...]], nominal: tuple[str, ...] = NOMINAL) -> tuple[Scenario, ...]:
    """The nominal scenarios of those axes and those levels of each axis, none twice."""
    chosen = [SCENARIOS[name] for name in nominal]
    for axis in AXES.values():
        for level in levels(axis.name):
            new = axis.level(min(level, len(axis.levels)))
            if not any(replace(new, name=known.name) == known for known in chosen):
                chosen.append(new)
    return tuple(chosen)
