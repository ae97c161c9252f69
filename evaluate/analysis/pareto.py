"""Success against cost of transport: the policies that none beats in both, and those that beat each of the others."""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from evaluate.analysis.effort import COST, cost_by_episode, mean_and_interval
from evaluate.analysis.score import Score
from evaluate.cells import PolicyScenarioResult
from evaluate.measures.episodes import weight
from evaluate.statistics.intervals import Interval
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import HARDWARE

COST_SCENARIOS = ("steady", "flat", f"steady{HARDWARE}", f"flat{HARDWARE}")
"""Scenarios whose cost counts: the first of them that the run has, else all together."""


@dataclass(frozen=True)
class ParetoPoint:
    """One policy. The fields are the keys of results.json."""

    policy: str
    success: float
    """Its score."""
    success_ci: Interval
    cost: float
    """Cost of transport; NaN of a policy that goes nowhere, or that did not run there."""
    cost_ci: Interval
    dominated_by: tuple[str, ...] = ()
    """Policies on the front with no less success and no higher cost, one of the two better."""


@dataclass(frozen=True)
class Pareto:
    """Every policy with a score. The fields are the keys of results.json."""

    cost_on: str
    """Scenario of the cost of transport; empty for all together."""
    front: tuple[str, ...]
    """Policies that no other dominates, the cheapest first."""
    points: tuple[ParetoPoint, ...]
    """The most successful first."""


def pareto(cells: Sequence[PolicyScenarioResult], scores: Sequence[Score], robot: Robot) -> Pareto:
    """The front of policies that have a score; cells all have the hardware profile, or none has."""
    cost_on, points = cost_scenario({cell.scenario.name for cell in cells}), []
    for each in scores:
        counted = [cell for cell in cells if cell.policy == each.policy and cost_on in ("", cell.scenario.name)]
        points.append(ParetoPoint(each.policy, each.score, each.ci, *_cost(counted, robot)))
    return pareto_front(cost_on, points)


def cost_scenario(scenarios: Container[str]) -> str:
    """The scenario of a run whose cost counts; empty for all together."""
    return next((name for name in COST_SCENARIOS if name in scenarios), "")


def pareto_front(cost_on: str, points: Sequence[ParetoPoint]) -> Pareto:
    """The front of policies whose success and cost are known; one without a cost is neither on it nor dominated."""
    front = [one for one in points if one.cost == one.cost and not any(_dominates(other, one) for other in points)]
    front.sort(key=lambda one: one.cost)
    by = {one.policy: tuple(other.policy for other in front if _dominates(other, one)) for one in points}
    marked = (replace(one, dominated_by=by[one.policy]) for one in sorted(points, key=lambda one: -one.success))
    return Pareto(cost_on, tuple(one.policy for one in front), tuple(marked))


def _dominates(a: ParetoPoint, b: ParetoPoint) -> bool:
    no_worse = a.success >= b.success and a.cost <= b.cost
    return no_worse and (a.success > b.success or a.cost < b.cost)


def _cost(cells: Sequence[PolicyScenarioResult], robot: Robot) -> tuple[float, Interval]:
    """Cost of transport of these cells together, with its interval over episodes, each with all of its scenarios; NaN
    of none."""
    if not cells:
        return np.nan, (np.nan, np.nan)
    weights = np.array([weight(robot, cell.scenario) for cell in cells])
    energy = np.mean([cell.measures.energy for cell in cells], axis=0)
    path = weights @ [cell.measures.distance for cell in cells] / weights.sum()
    return mean_and_interval(cost_by_episode(energy, path, float(weights.mean())), COST)
