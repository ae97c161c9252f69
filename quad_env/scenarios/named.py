"""The named scenarios: flat ground, and each axis of disturbance at its nominal severity.

A scenario is never tuned to a policy. Write one with `dataclasses.replace` or the constructor and pass it to `make`.
"""

from functools import lru_cache

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import axes_of
from quad_env.scenarios.combination import combined, is_combination
from quad_env.scenarios.disturbances import Pushes
from quad_env.scenarios.scenario import Scenario

__all__ = ["SCENARIOS", "Pushes", "Scenario", "scenario"]


@lru_cache(maxsize=32)
def scenarios_of(robot: Robot) -> dict[str, Scenario]:
    """The named scenarios, as hard for the robot as for SimpleQuad."""
    return {name: axis.scenario(axis.nominal, name) for name, axis in axes_of(robot).items()}


SCENARIOS = scenarios_of(SIMPLE_QUAD)


def scenario(which: str | Scenario, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario of that name, as hard for the robot as for SimpleQuad, or of a combination in physical units such as
    `payload=15+slope=10`, or the scenario itself; ValueError lists the valid names."""
    if isinstance(which, Scenario):
        return which
    if isinstance(which, str) and is_combination(which):
        return combined(which, robot)
    if not isinstance(which, str) or which not in SCENARIOS:
        valid = f"{', '.join(SCENARIOS)}, severities of axes such as payload=15+slope=10, or a quad_env.Scenario"
        raise ValueError(f"unknown scenario {which!r}; valid: {valid}")
    return scenarios_of(robot)[which]
