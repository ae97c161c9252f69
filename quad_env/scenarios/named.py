"""The named scenarios: flat ground, and each axis of disturbance at its nominal severity.

A scenario is never tuned to a policy. Write one with `dataclasses.replace` or the constructor and pass it to `make`.
"""

from quad_env.scenarios.axes import AXES
from quad_env.scenarios.disturbances import Pushes
from quad_env.scenarios.scenario import Scenario

__all__ = ["SCENARIOS", "Pushes", "Scenario", "scenario"]

SCENARIOS: dict[str, Scenario] = {axis.name: axis.scenario(axis.nominal, axis.name) for axis in AXES.values()}


def scenario(which: str | Scenario) -> Scenario:
    """The scenario of that name, or the scenario itself; ValueError lists the valid names."""
    if isinstance(which, Scenario):
        return which
    if not isinstance(which, str) or which not in SCENARIOS:
        raise ValueError(f"unknown scenario {which!r}; valid: {', '.join(SCENARIOS)}, or a quad_env.Scenario")
    return SCENARIOS[which]
