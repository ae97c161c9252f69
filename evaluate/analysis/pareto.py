"""Pareto front of success against cost of transport: policies that no other policy beats in both."""

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
"""Scenarios for the measurement of the cost of transport; the first one that the run has is used.

The cost is measured over all scenarios together if the run has none of these.
"""


@dataclass(frozen=True)
class ParetoPoint:
    """Success and cost of transport of one policy. The field names are the keys in results.json."""

    policy: str
    """Name of the policy."""
    success: float
    """Score of the policy: mean success over the disturbance axes, 0 … 1."""
    success_ci: Interval
    """95 % confidence interval of `success`."""
    cost: float
    """Cost of transport, without unit; NaN if the policy does not move or did not run the scenario."""
    cost_ci: Interval
    """95 % confidence interval of `cost`."""
    dominated_by: tuple[str, ...] = ()
    """Names of the policies on the Pareto front that dominate this policy.

    They are at least as good in success and in cost, and better in one of them.
    """


@dataclass(frozen=True)
class Pareto:
    """Pareto front of a run, with success and cost of transport of all policies that have a score.

    The field names are the keys in results.json.
    """

    cost_on: str
    """Name of the scenario on which the cost of transport is measured; empty for all scenarios together."""
    front: tuple[str, ...]
    """Names of the policies that no other policy dominates, the lowest cost of transport first."""
    points: tuple[ParetoPoint, ...]
    """Success and cost of transport of all policies with a score, the most successful first."""


def compute_pareto(cells: Sequence[PolicyScenarioResult], scores: Sequence[Score], robot: Robot) -> Pareto:
    """Compute success, cost of transport and Pareto front of the policies that have a score.

    Args:
        cells: Results, one for each pair of policy and scenario, either all with the hardware profile or all without
            it.
        scores: Scores of the policies.
        robot: Robot of the run, for its weight.

    Returns:
        Success and cost of each policy, and the Pareto front.
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
    """Find the policies that no other policy dominates in success and cost of transport.

    Args:
        cost_on: Name of the scenario on which the cost of transport is measured; empty for all scenarios together.
        points: Success and cost of each policy. A policy with a cost of NaN is neither on the front nor dominated.

    Returns:
        The Pareto front, and the points with the names of the policies that dominate them.
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
    """Return the names of the policies on the Pareto `front` that dominate the policy of `point`."""
    return tuple(other.policy for other in front if _dominates(other, point))


def _dominates(a: ParetoPoint, b: ParetoPoint) -> bool:
    no_worse = a.success >= b.success and a.cost <= b.cost
    return no_worse and (a.success > b.success or a.cost < b.cost)


def _cost(cells: Sequence[PolicyScenarioResult], robot: Robot) -> tuple[float, Interval]:
    """Compute the cost of transport of one policy over all `cells`, with a 95 % bootstrap interval.

    The bootstrap resamples episodes, each with its results on all scenarios.

    Args:
        cells: Results of the policy, one for each scenario.
        robot: Robot of the run, for its weight.

    Returns:
        Cost of transport and interval, without unit; NaN if there are no results.
    """
    if not cells:
        return np.nan, (np.nan, np.nan)
    weights = np.array([weight(robot, cell.scenario) for cell in cells])
    energy = np.mean([cell.measures.energy for cell in cells], axis=0)
    distance = weights @ [cell.measures.distance for cell in cells] / weights.sum()
    return mean_and_interval(cost_by_episode(energy, distance, float(weights.mean())), COST)
