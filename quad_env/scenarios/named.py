"""The named scenarios: flat ground, and each axis of disturbance at its nominal severity.

A scenario is never tuned to a policy. Write one with `dataclasses.replace` or the constructor and pass it to `make`.
"""

from functools import lru_cache

from quad_env.robots.named import robot_of
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import Axis, axes_of
from quad_env.scenarios.combination import combined, is_combination
from quad_env.scenarios.disturbances import Pushes
from quad_env.scenarios.scenario import Scenario

__all__ = ["SCENARIOS", "Pushes", "Scenario", "scenario"]

WRITTEN = "a level of an axis such as push:3, severities of axes such as push=42 or payload=15+slope=10"
"""How scenarios without a name of their own are written."""


@lru_cache(maxsize=32)
def scenarios_of(robot: Robot) -> dict[str, Scenario]:
    """The named scenarios, as hard for the robot as for SimpleQuad."""
    return {name: axis.scenario(axis.nominal, name) for name, axis in axes_of(robot).items()}


SCENARIOS = scenarios_of(SIMPLE_QUAD)


def scenario(which: str | Scenario, robot: str | Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario of a name such as `push`, of a level such as `push:3`, of severities in physical units such as
    `push=42` or `payload=15+slope=10`, or the scenario itself; ValueError lists the valid names.

    Names and levels are as hard for the robot as for SimpleQuad.
    """
    if isinstance(which, Scenario):
        return which
    found = find(which, robot_of(robot)) if isinstance(which, str) else None
    if found is None:
        raise ValueError(
            f"unknown scenario {which!r}; valid: {', '.join(SCENARIOS)}, {WRITTEN}, or a quad_env.Scenario"
        )
    return found


def find(name: str, robot: Robot = SIMPLE_QUAD) -> Scenario | None:
    """As `scenario`, but None where the name is that of no scenario and no axis."""
    if is_combination(name):
        return combined(name, robot)
    axis, colon, level = name.partition(":")
    if colon and axis in SCENARIOS:
        return _level(axes_of(robot)[axis], level)
    return (SCENARIOS if robot == SIMPLE_QUAD else scenarios_of(robot)).get(name)


def _level(axis: Axis, level: str) -> Scenario:
    if not level.isdecimal():
        valid = f"{axis.name}:1 to {axis.name}:{len(axis.levels)}, {axis.name}:all where several may be named"
        raise ValueError(f"'{axis.name}:{level}' is no level of {axis.name}; valid: {valid}")
    return axis.level(int(level))
