"""The batteries: the scenarios that every policy is judged on, and what a name on the command line stands for."""

from collections.abc import Callable
from dataclasses import replace
from itertools import chain

from evaluate.rollouts.scenario_file import from_file
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES, Axis, axes_of
from quad_env.scenarios.named import SCENARIOS, WRITTEN, Scenario, find, scenarios_of

NOMINAL = ("flat", "push", "rough")
"""What the quick battery begins with."""
QUICK_LEVELS: dict[str, tuple[int, ...]] = {"push": (4,), "rough": (4,)}
"""Levels in the quick battery, by axis."""
HARDER = 2
"""Levels of each axis that the default battery has beyond the nominal one: hard, and hardest."""
ALL = "all"
_FILE = ".py:"


BATTERIES: dict[str, Callable[[Robot], tuple[Scenario, ...]]] = {
    "quick": lambda robot: _battery(robot, lambda axis: QUICK_LEVELS.get(axis.name, ())),
    "default": lambda robot: _battery(robot, _nominal_and_harder, tuple(AXES)),
    "full": lambda robot: _battery(robot, lambda axis: tuple(range(1, len(axis.levels) + 1)), tuple(AXES)),
    ALL: lambda robot: tuple(scenarios_of(robot).values()),
}
"""Names that stand for several scenarios: a first look; every axis at its nominal severity and the next two levels;
every axis at every level; every axis at its nominal severity."""
_VALID = (
    f"{', '.join((*SCENARIOS, *BATTERIES))}, {WRITTEN}, every level of an axis such as push:all, "
    "a file of yours such as my_file.py:NAME"
)


def resolve(names: tuple[str, ...], robot: Robot = SIMPLE_QUAD) -> tuple[Scenario, ...]:
    """A robot's scenarios of names as `push`, `push:3`, `push:all`, `payload=15+slope=10`, `full`, `file.py:NAME`;
    ValueError lists the valid ones."""
    if not names:
        raise ValueError(f"no scenario given; valid: {_VALID}")
    found = tuple(chain.from_iterable(_named(name, robot) for name in names))
    called = [each.name for each in found]
    if twice := [name for name in dict.fromkeys(called) if called.count(name) > 1]:
        raise ValueError(f"a scenario is given twice: {' '.join(twice)}")
    return found


def one(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """A robot's scenario of that name; ValueError where there is none, or several."""
    found, *more = resolve((name,), robot)
    if more:
        raise ValueError(f"{name} is {1 + len(more)} scenarios: name one of them")
    return found


def of_file(name: str) -> bool:
    """Whether a name stands for what a Python file of the user's makes."""
    return _FILE in name


def _named(name: str, robot: Robot) -> tuple[Scenario, ...]:
    if name in BATTERIES:
        return BATTERIES[name](robot)
    if of_file(name):
        return from_file(name)
    axis, colon, level = name.partition(":")
    if colon and axis in AXES and level == ALL:
        return tuple(map(axes_of(robot)[axis].level, range(1, len(AXES[axis].levels) + 1)))
    if (found := find(name, robot)) is None:
        raise ValueError(f"unknown scenario {name!r}; valid: {_VALID}")
    return (found,)


def _nominal_and_harder(axis: Axis) -> tuple[int, ...]:
    """Levels of the default battery."""
    return tuple(range(axis.nominal_level, axis.nominal_level + HARDER + 1))


def _battery(
    robot: Robot, levels: Callable[[Axis], tuple[int, ...]], nominal: tuple[str, ...] = NOMINAL
) -> tuple[Scenario, ...]:
    """A robot's nominal scenarios of those axes and those levels of each axis, none twice."""
    chosen = [scenarios_of(robot)[name] for name in nominal]
    for axis in axes_of(robot).values():
        for level in levels(axis):
            new = axis.level(min(level, len(axis.levels)))
            if not any(replace(new, name=known.name) == known for known in chosen):
                chosen.append(new)
    return tuple(chosen)
