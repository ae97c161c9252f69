"""Results of groups of policies that one algorithm has trained with several seeds, as one entry each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from evaluate.analysis.effort import cost_by_episode
from evaluate.analysis.pareto import cost_scenario
from evaluate.analysis.score import ScoredCells, select_scored_cells
from evaluate.cells import PolicyScenarioResult
from evaluate.measures.episodes import weight
from evaluate.statistics.intervals import Floats, Interval
from evaluate.statistics.training_seeds import (
    MIN_BOOTSTRAP_SEEDS,
    interquartile_mean,
    interquartile_mean_interval,
    mean_interval,
    rate_interval,
)
from quad_env.robots.robot import Robot

RATES: Interval = (0.0, 1.0)
"""Smallest and largest possible value of a success rate or score."""


@dataclass(frozen=True)
class GroupRate:
    """Success of a group of training seeds on one scenario. The field names are the keys in results.json."""

    episodes: int
    """Number of episodes of all training seeds of the group together on the scenario."""
    success_rate: float
    """Mean success rate of the training seeds of the group on the scenario, 0 … 1."""
    success_rate_ci: Interval
    """95 % interval of `success_rate` over training seeds and episodes, 0 … 1."""


@dataclass(frozen=True)
class GroupScore:
    """Score of a group of training seeds over the scenarios of a run. The field names are the keys in results.json."""

    score: float
    """Mean score of the training seeds of the group, 0 … 1; see `evaluate.analysis.score`."""
    ci: Interval
    """95 % interval of `score` over training seeds and episodes, 0 … 1: a stratified bootstrap.

    For two training seeds, or for a single scenario, it is the interval of a rate.
    """
    interquartile_mean: float
    """Mean of the middle half of the success rates of all training seeds of the group on all scenarios, 0 … 1."""
    interquartile_mean_ci: Interval
    """95 % stratified bootstrap interval of `interquartile_mean`, 0 … 1; NaN for two training seeds."""


@dataclass(frozen=True)
class SeedGroup:
    """Results of policies that one algorithm has trained with several seeds. The field names are keys in results.json.

    All intervals include the variation between training seeds.
    """

    name: str
    """Name of the group, as the user gave it: NAME=PATTERN."""
    policies: tuple[str, ...]
    """Labels of the policies of the group, one for each training seed."""
    scenarios: dict[str, GroupRate]
    """Name of a scenario that all policies of the group ran -> success of the group."""
    score: GroupScore | None
    """Score on the scenarios without the hardware profile; None if a policy of the group has no score."""
    hardware_score: GroupScore | None
    """Score on the scenarios with the hardware profile; None if a policy of the group has no score."""
    cost_on: str
    """Name of the scenario on which `cost_of_transport` is measured; empty for all scenarios together."""
    cost_of_transport: float
    """Mean cost of transport of the policies of the group, without unit; NaN if it is not defined for each of them."""
    cost_of_transport_ci: Interval
    """95 % bootstrap interval of `cost_of_transport` over training seeds and episodes, without unit."""


def summarise_groups(
    cells: Sequence[PolicyScenarioResult], groups: Mapping[str, Sequence[str]], robot: Robot
) -> tuple[SeedGroup, ...]:
    """Summarise each group of training seeds over its policies and their episodes.

    Args:
        cells: Measured episodes of an evaluation, one result for each policy-scenario pair.
        groups: Name of a group -> labels of its policies.
        robot: Robot of the evaluation; its weight enters the cost of transport.

    Returns:
        Summary of each group, in the order of `groups`.
    """
    by_pair = {(cell.policy, cell.scenario.name): cell for cell in cells}
    scored = [select_scored_cells(cells, hardware=hardware) for hardware in (False, True)]
    return tuple(_summarise(name, tuple(policies), by_pair, scored, robot) for name, policies in groups.items())


def _summarise(
    name: str,
    policies: tuple[str, ...],
    by_pair: Mapping[tuple[str, str], PolicyScenarioResult],
    scored: Sequence[ScoredCells],
    robot: Robot,
) -> SeedGroup:
    """Summarise one group of training seeds.

    Args:
        name: Name of the group.
        policies: Labels of its policies.
        by_pair: (label of a policy, name of a scenario) -> measured episodes.
        scored: Results that enter the score without, and with, the hardware profile.
        robot: Robot of the evaluation.

    Returns:
        The summary.
    """
    scenarios = dict.fromkeys(scenario for _, scenario in by_pair)
    common = {
        scenario: [by_pair[policy, scenario] for policy in policies]
        for scenario in scenarios
        if all((policy, scenario) in by_pair for policy in policies)
    }
    cost_on = cost_scenario(common)
    cost_cells = [cells for scenario, cells in common.items() if cost_on in ("", scenario)]
    costs = _costs(cost_cells, robot)
    return SeedGroup(
        name=name,
        policies=policies,
        scenarios={scenario: _rate(cells) for scenario, cells in common.items()},
        score=_score(policies, scored[0]),
        hardware_score=_score(policies, scored[1]),
        cost_on=cost_on,
        cost_of_transport=float(costs.mean()) if costs.size else np.nan,
        cost_of_transport_ci=mean_interval(costs, (0.0, np.inf)),
    )


def _rate(cells: Sequence[PolicyScenarioResult]) -> GroupRate:
    """Compute the success rate of a group on one scenario from the results `cells` of its policies."""
    success = np.array([cell.measures.succeeded for cell in cells], np.float64)
    return GroupRate(success.size, float(success.mean()), rate_interval(success))


def _score(policies: Sequence[str], scored: ScoredCells) -> GroupScore | None:
    """Compute mean score and interquartile mean of a group of training seeds.

    Args:
        policies: Labels of the policies of the group.
        scored: Results that enter the score.

    Returns:
        The score; None if a policy of the group did not run all scenarios of the score.
    """
    if not scored.scenarios or any(policy not in scored.cells_by_policy for policy in policies):
        return None
    by_episode = np.array([scored.by_episode(policy) for policy in policies])
    has_bootstrap = len(scored.scenarios) > 1 and len(policies) >= MIN_BOOTSTRAP_SEEDS
    middle, middle_ci = interquartile_success(policies, scored)
    return GroupScore(
        score=float(by_episode.mean()),
        ci=mean_interval(by_episode, RATES) if has_bootstrap else rate_interval(by_episode),
        interquartile_mean=middle,
        interquartile_mean_ci=middle_ci,
    )


def interquartile_success(policies: Sequence[str], scored: ScoredCells) -> tuple[float, Interval]:
    """Compute the interquartile mean of the success rates of all given policies on all scenarios of the score.

    Args:
        policies: Labels of the policies, one for each training seed; all of them have a score.
        scored: Results that enter the score.

    Returns:
        interquartile_mean: Mean of the middle half of the success rates, 0 … 1.
        interval: 95 % interval, over training seeds and episodes; over episodes alone for one policy.
    """
    success = np.array(
        [
            [scored.cells_by_policy[policy][scenario].measures.succeeded for scenario in scored.scenarios]
            for policy in policies
        ],
        np.float64,
    ).transpose(0, 2, 1)
    middle = float(interquartile_mean(success.mean(axis=1).ravel()))
    return middle, interquartile_mean_interval(success, RATES)


def _costs(cells: Sequence[Sequence[PolicyScenarioResult]], robot: Robot) -> Floats:
    """Compute the linearised cost of transport of each training seed in each episode.

    Args:
        cells: For each scenario, the results of the s policies of the group.
        robot: Robot of the evaluation.

    Returns:
        Linearised cost of transport, (s, n), without unit; the mean of a row is the cost of all episodes of this policy
        together. The array is empty if no scenario is given.
    """
    if not cells:
        return np.empty((0, 0))
    weights = np.array([weight(robot, group[0].scenario) for group in cells])
    energy = np.mean([[cell.measures.energy for cell in group] for group in cells], axis=0)
    distances = np.array([[cell.measures.distance for cell in group] for group in cells])
    distance = np.einsum("k,ksn->sn", weights, distances) / weights.sum()
    mean_weight = float(weights.mean())
    return np.array([cost_by_episode(*row, mean_weight) for row in zip(energy, distance, strict=True)])
