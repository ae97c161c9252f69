"""The named scenarios: flat ground, and each axis of disturbance at its nominal severity.

A scenario is never tuned to a policy. Write one with `dataclasses.replace` or the constructor and pass it to `make`.
"""

from quad_env.scenarios.axes import AXES
from quad_env.scenarios.combination import combined, is_combination
from quad_env.scenarios.disturbances import Pushes
from quad_env.scenarios.scenario import Scenario

__all__ = ["SCENARIOS", "Pushes", "Scenario", "scenario"]

SCENARIOS: dict[str, Scenario] = {axis.name: axis.scenario(axis.nominal, axis.name) for axis in AXES.values()}


def scenario(which: str | Scenario) -> Scenario:
    """The scenario of that name, or of a combination such as `payload=15+slope=10`, or the scenario itself; ValueError
    lists the valid names."""
    if isinstance(which, Scenario):
        return which
    if isinstance(which, str) and is_combination(which):
        return combined(which)
    if not isinstance(which, str) or which not in SCENARIOS:
        valid = f"{', '.join(SCENARIOS)}, severities of axes such as payload=15+slope=10, or a quad_env.Scenario"
        raise ValueError(f"unknown scenario {which!r}; valid: {valid}")
    return SCENARIOS[which]
