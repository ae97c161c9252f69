"""The batteries: the scenarios that every policy is judged on, and what a name on the command line stands for."""

from collections.abc import Callable
from dataclasses import replace
from itertools import chain

from evaluate.rollouts.scenario_file import from_file
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.named import SCENARIOS, Scenario, scenario

NOMINAL = ("flat", "push", "rough")
"""What every battery begins with."""
QUICK_LEVELS: dict[str, tuple[int, ...]] = {"push": (4,), "rough": (4,)}
"""Levels in the quick battery, by axis."""
DEFAULT_LEVELS: dict[str, tuple[int, ...]] = {
    "push": (4, 6),
    "rough": (4, 6),
    "force": (3, 4, 5),
    "slope": (3, 6, 7),
    "surprise": (2, 4, 5),
}
"""Levels in the default battery, by axis: three severities with the nominal one, about the trot's breaking point."""
USUAL_LEVELS = (4,)
"""Levels of every other axis."""
ALL = "all"
_FILE = ".py:"


BATTERIES: dict[str, Callable[[], tuple[Scenario, ...]]] = {
    "quick": lambda: _battery(lambda axis: QUICK_LEVELS.get(axis, ())),
    "default": lambda: _battery(lambda axis: DEFAULT_LEVELS.get(axis, USUAL_LEVELS)),
    "full": lambda: _battery(lambda axis: tuple(range(1, len(AXES[axis].levels) + 1))),
    ALL: lambda: tuple(SCENARIOS.values()),
}
"""Names that stand for several scenarios: a first look; every axis at three severities where breaking points are
looked for and at one elsewhere; every axis at every level; every axis at its nominal severity."""


def resolve(names: tuple[str, ...]) -> tuple[Scenario, ...]:
    """Scenarios of names as `push`, `push:3`, `push:all`, `full`, `file.py:NAME`; ValueError lists the valid ones."""
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
    levels = "a level of an axis such as push:3 or push:all, a file of yours such as my_file.py:NAME"
    return f"{', '.join((*SCENARIOS, *BATTERIES))}, {levels}"


def _battery(levels: Callable[[str], tuple[int, ...]]) -> tuple[Scenario, ...]:
    """The nominal scenarios and those levels of each axis, none twice."""
    chosen = [SCENARIOS[name] for name in NOMINAL]
    for axis in AXES.values():
        for level in levels(axis.name):
            new = axis.level(min(level, len(axis.levels)))
            if not any(replace(new, name=known.name) == known for known in chosen):
                chosen.append(new)
    return tuple(chosen)
