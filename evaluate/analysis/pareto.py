"""Pareto front of success against cost of transport."""

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
"""Scenarios on which the cost of transport is measured: the first one that the run has.

The cost is measured on all scenarios together if the run has none of these.
"""


@dataclass(frozen=True)
class ParetoPoint:
    """Success and cost of transport of one policy. The fields are the keys of results.json."""

    policy: str
    """Name of the policy."""
    success: float
    """Score of the policy: mean success over the axes, 0 … 1."""
    success_ci: Interval
    """95 % interval of the score."""
    cost: float
    """Cost of transport; NaN if the policy does not move or did not run the scenario."""
    cost_ci: Interval
    """95 % interval of the cost of transport."""
    dominated_by: tuple[str, ...] = ()
    """Policies on the front that are at least as good in success and cost, and better in one of the two."""


@dataclass(frozen=True)
class Pareto:
    """Pareto front of a run, and the points of all policies with a score.

    The fields are the keys of results.json.
    """

    cost_on: str
    """Scenario on which the cost of transport is measured; empty for all scenarios together."""
    front: tuple[str, ...]
    """Policies that no other policy dominates, the cheapest first."""
    points: tuple[ParetoPoint, ...]
    """Points of all policies with a score, the most successful first."""


def compute_pareto(cells: Sequence[PolicyScenarioResult], scores: Sequence[Score], robot: Robot) -> Pareto:
    """Compute the Pareto front of the policies that have a score.

    Args:
        cells: Cells (episodes of one policy on one scenario), all with the hardware profile or all without it.
        scores: Scores of the policies.
        robot: Robot, for its weight.

    Returns:
        Points of the policies, and the front.
    """
    cost_on = cost_scenario({cell.scenario.name for cell in cells})
    points = []
    for score in scores:
        cost_cells = [cell for cell in cells if cell.policy == score.policy and cost_on in ("", cell.scenario.name)]
        cost, cost_ci = _cost(cost_cells, robot)
        points.append(ParetoPoint(score.policy, score.score, score.ci, cost, cost_ci))
    return find_pareto_front(cost_on, points)


def cost_scenario(scenarios: Container[str]) -> str:
    """Return the name of the first scenario of COST_SCENARIOS in a run; empty if the run has none."""
    return next((name for name in COST_SCENARIOS if name in scenarios), "")


def find_pareto_front(cost_on: str, points: Sequence[ParetoPoint]) -> Pareto:
    """Find the policies that no other one dominates.

    Args:
        cost_on: Scenario on which the cost of transport is measured; empty for all scenarios together.
        points: Success and cost of each policy. A policy with a cost of NaN is neither on the front nor dominated.

    Returns:
        Points with the policies that dominate them, and the front.
    """
    front = [
        point for point in points if not np.isnan(point.cost) and not any(_dominates(other, point) for other in points)
    ]
    front.sort(key=lambda point: point.cost)
    by_success = sorted(points, key=lambda point: -point.success)
    return Pareto(
        cost_on,
        tuple(point.policy for point in front),
        tuple(replace(point, dominated_by=_dominating(front, point)) for point in by_success),
    )


def _dominating(front: Sequence[ParetoPoint], point: ParetoPoint) -> tuple[str, ...]:
    """Return the names of the policies on the front that dominate a point."""
    return tuple(other.policy for other in front if _dominates(other, point))


def _dominates(a: ParetoPoint, b: ParetoPoint) -> bool:
    no_worse = a.success >= b.success and a.cost <= b.cost
    return no_worse and (a.success > b.success or a.cost < b.cost)


def _cost(cells: Sequence[PolicyScenarioResult], robot: Robot) -> tuple[float, Interval]:
    """Return the cost of transport over all `cells` of a policy, and its bootstrap interval.

    The bootstrap resamples episodes, each with its results on all scenarios. Cost and interval are NaN for an empty
    sequence of cells.
    """
    if not cells:
        return np.nan, (np.nan, np.nan)
    weights = np.array([weight(robot, cell.scenario) for cell in cells])
    energy = np.mean([cell.measures.energy for cell in cells], axis=0)
    distance = weights @ [cell.measures.distance for cell in cells] / weights.sum()
    return mean_and_interval(cost_by_episode(energy, distance, float(weights.mean())), COST)
