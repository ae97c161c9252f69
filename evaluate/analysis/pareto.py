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
"""Scenarios for the cost of transport: the first of them in the run, or all scenarios together without any."""


@dataclass(frozen=True)
class ParetoPoint:
    """Success and cost of transport of one policy. The fields are the keys of results.json."""

    policy: str
    """Name of the policy."""
    success: float
    """Score of the policy."""
    success_ci: Interval
    """95 % interval of the score."""
    cost: float
    """Cost of transport; NaN for a policy that does not move, or that did not run on the scenario."""
    cost_ci: Interval
    """95 % interval of the cost of transport."""
    dominated_by: tuple[str, ...] = ()
    """Policies on the front with no less success and no higher cost, and one of the two better."""


@dataclass(frozen=True)
class Pareto:
    """Points of all policies with a score, and the front. The fields are the keys of results.json."""

    cost_on: str
    """Scenario of the cost of transport; empty for all scenarios together."""
    front: tuple[str, ...]
    """Policies that no other policy dominates, the cheapest first."""
    points: tuple[ParetoPoint, ...]
    """Points, the most successful first."""


def compute_pareto(cells: Sequence[PolicyScenarioResult], scores: Sequence[Score], robot: Robot) -> Pareto:
    """Compute the Pareto front of the policies that have a score.

    Args:
        cells: Cells, all with the hardware profile or all without it.
        scores: Scores of the policies.
        robot: Robot, for its weight.

    Returns:
        Points and front.
    """
    cost_on = cost_scenario({cell.scenario.name for cell in cells})
    points = []
    for score in scores:
        cost_cells = [cell for cell in cells if cell.policy == score.policy and cost_on in ("", cell.scenario.name)]
        cost, cost_ci = _cost(cost_cells, robot)
        points.append(ParetoPoint(score.policy, score.score, score.ci, cost, cost_ci))
    return find_pareto_front(cost_on, points)


def cost_scenario(scenarios: Container[str]) -> str:
    """Return the scenario of a run that the cost of transport is taken from; empty for all together."""
    return next((name for name in COST_SCENARIOS if name in scenarios), "")


def find_pareto_front(cost_on: str, points: Sequence[ParetoPoint]) -> Pareto:
    """Find the policies that no other one dominates.

    Args:
        cost_on: Scenario of the cost of transport; empty for all together.
        points: Success and cost of the policies; one without a cost is neither on the front nor dominated.

    Returns:
        Points and front.
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
    """Return the policies on the front that dominate a point."""
    return tuple(other.policy for other in front if _dominates(other, point))


def _dominates(a: ParetoPoint, b: ParetoPoint) -> bool:
    no_worse = a.success >= b.success and a.cost <= b.cost
    return no_worse and (a.success > b.success or a.cost < b.cost)


def _cost(cells: Sequence[PolicyScenarioResult], robot: Robot) -> tuple[float, Interval]:
    """Return the cost of transport of these cells together, with its interval over episodes.

    An episode is resampled with all of its scenarios. Without cells the result is NaN.
    """
    if not cells:
        return np.nan, (np.nan, np.nan)
    weights = np.array([weight(robot, cell.scenario) for cell in cells])
    energy = np.mean([cell.measures.energy for cell in cells], axis=0)
    distance = weights @ [cell.measures.distance for cell in cells] / weights.sum()
    return mean_and_interval(cost_by_episode(energy, distance, float(weights.mean())), COST)
