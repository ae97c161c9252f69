"""Pareto front of success against cost of transport: the policies that no other policy dominates."""

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
"""Names of the scenarios on which the cost of transport is measured; the first available one is used.

The cost is measured over all scenarios together if the evaluation has none of these scenarios.
"""


@dataclass(frozen=True)
class ParetoPoint:
    """Success and cost of transport of one policy: its point in the plot of the Pareto front.

    The field names are the keys in results.json.
    """

    policy: str
    """Name of the policy that has this success and cost."""
    success: float
    """Score of the policy: mean success over all kinds of disturbance in the evaluation, 0 … 1."""
    success_ci: Interval
    """95 % confidence interval of the score `success`, 0 … 1."""
    cost: float
    """Cost of transport (energy / (weight · distance)), without unit.

    It is NaN if the robot hardly moves, or if the policy did not run the scenario on which the cost is measured.
    """
    cost_ci: Interval
    """95 % bootstrap interval of the cost of transport `cost`, without unit."""
    dominated_by: tuple[str, ...] = ()
    """Names of the policies on the Pareto front that dominate this policy.

    A policy dominates another if it is at least as good in both success and cost of transport, and better in one.
    """


@dataclass(frozen=True)
class Pareto:
    """Pareto front of an evaluation, with success and cost of transport of all policies that have a score.

    The field names are the keys in results.json.
    """

    cost_on: str
    """Name of the scenario on which the cost of transport is measured; empty for all scenarios together."""
    front: tuple[str, ...]
    """Names of the policies on the Pareto front, the lowest cost of transport first.

    No other policy is at least as good both in success and in cost of transport, and better in one of the two.
    """
    points: tuple[ParetoPoint, ...]
    """Success and cost of transport of all policies with a score, the most successful first."""


def compute_pareto(cells: Sequence[PolicyScenarioResult], scores: Sequence[Score], robot: Robot) -> Pareto:
    """Compute success, cost of transport and Pareto front of the policies that have a score.

    Args:
        cells: Measured episodes, one result for each policy-scenario pair. Either all of the scenarios have the
            hardware profile, or none of them has it.
        scores: Scores (mean success) of the policies.
        robot: Robot of the evaluation; its weight enters the cost of transport.

    Returns:
        Success and cost of transport of each policy, and the Pareto front.
    """
    cost_on = cost_scenario({cell.scenario.name for cell in cells})
    points = []
    for score in scores:
        cost_cells = [cell for cell in cells if cell.policy == score.policy and cost_on in ("", cell.scenario.name)]
        cost, cost_ci = _cost(cost_cells, robot)
        points.append(ParetoPoint(score.policy, score.score, score.ci, cost, cost_ci))
    return find_pareto_front(cost_on, points)


def cost_scenario(scenarios: Container[str]) -> str:
    """Return the name of the scenario on which the cost of transport is measured.

    Args:
        scenarios: Names of the scenarios of the evaluation.

    Returns:
        The first name in COST_SCENARIOS that is among `scenarios`; empty if none of them is.
    """
    return next((name for name in COST_SCENARIOS if name in scenarios), "")


def find_pareto_front(cost_on: str, points: Sequence[ParetoPoint]) -> Pareto:
    """Find the Pareto front: the policies that no other policy dominates in success and cost of transport.

    Args:
        cost_on: Name of the scenario on which the cost of transport is measured; empty for all scenarios together.
        points: Success and cost of transport of each policy. A policy with a cost of NaN is not on the front, and no
            policy dominates it.

    Returns:
        The Pareto front, and a copy of each point with the names of the policies that dominate its policy.
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
    """Return the names of the policies that dominate one policy in success and cost of transport.

    Args:
        front: Success and cost of transport of the policies on the Pareto front.
        point: Success and cost of transport of the policy.

    Returns:
        Names of the policies on the front that are at least as good in success and cost, and better in one of them.
    """
    return tuple(other.policy for other in front if _dominates(other, point))


def _dominates(a: ParetoPoint, b: ParetoPoint) -> bool:
    """Return True if policy `a` is at least as good as `b` in success and cost, and better in one of them."""
    no_worse = a.success >= b.success and a.cost <= b.cost
    return no_worse and (a.success > b.success or a.cost < b.cost)


def _cost(cells: Sequence[PolicyScenarioResult], robot: Robot) -> tuple[float, Interval]:
    """Compute the cost of transport of one policy over some scenarios, with a 95 % bootstrap interval.

    The bootstrap resamples episode seeds. A seed is drawn together with its episodes on all of the scenarios.

    Args:
        cells: Results of the policy, one for each scenario, with the same seeds.
        robot: Robot of the evaluation; its weight enters the cost of transport.

    Returns:
        Cost of transport and its interval, without unit; NaN if `cells` is empty.
    """
    if not cells:
        return np.nan, (np.nan, np.nan)
    weights = np.array([weight(robot, cell.scenario) for cell in cells])
    energy = np.mean([cell.measures.energy for cell in cells], axis=0)
    distance = weights @ [cell.measures.distance for cell in cells] / weights.sum()
    return mean_and_interval(cost_by_episode(energy, distance, float(weights.mean())), COST)
