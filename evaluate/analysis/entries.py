"""Entries of tables and figures of a run: single policies, and groups of training seeds as one entry each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from evaluate.analysis.results import Results
from evaluate.analysis.score import Score, ScoredCells, select_scored_cells
from evaluate.analysis.seed_groups import GroupScore, SeedGroup, interquartile_success
from evaluate.statistics.intervals import Interval


class Statistic(NamedTuple):
    """A number with its 95 % interval, both in the unit of the number."""

    value: float
    """The number; NaN if it is not defined."""
    ci: Interval
    """Lower and upper end of the 95 % interval; NaN if there is no interval."""


UNKNOWN = Statistic(np.nan, (np.nan, np.nan))
"""Number that is not defined."""


@dataclass(frozen=True)
class Entry:
    """One policy, or one group of training seeds, in a table or figure of a run."""

    name: str
    """Label of the policy, or name of the group."""
    policies: tuple[str, ...]
    """Labels of the policies of the entry: one, or one for each training seed of a group."""
    episodes: int
    """Number of episodes on each scenario, of all training seeds together."""
    success: Mapping[str, Statistic]
    """Name of a scenario -> success rate, 0 … 1; scenarios that the entry did not run are left out."""
    score: Statistic
    """Score on the scenarios without the hardware profile, 0 … 1."""
    hardware_score: Statistic
    """Score on the scenarios with the hardware profile, 0 … 1."""
    interquartile_mean: Statistic
    """Interquartile mean of the success rates on the scenarios of `score`, 0 … 1."""
    hardware_interquartile_mean: Statistic
    """Interquartile mean of the success rates on the scenarios of `hardware_score`, 0 … 1."""
    cost: Statistic
    """Cost of transport, without unit, on the scenario that the Pareto front of the run uses."""

    @property
    def is_group(self) -> bool:
        """True if the entry is a group of training seeds."""
        return len(self.policies) > 1


def list_entries(results: Results) -> tuple[Entry, ...]:
    """List the entries of a run: each group of training seeds, and each policy that is in no group.

    A policy has the same figures as in the report.

    Args:
        results: Results of the run.

    Returns:
        The entries in the order of the run; a group has the place of its first policy.
    """
    groups = {policy: group for group in results.groups for policy in group.policies}
    scored = (select_scored_cells(results.cells), select_scored_cells(results.cells, hardware=True))
    entries: dict[str, Entry] = {}
    for policy in results.policies:
        group = groups.get(policy)
        if group is None:
            entries[policy] = _policy_entry(results, policy, scored)
        elif group.name not in entries:
            entries[group.name] = _group_entry(group)
    return tuple(entries.values())


def _policy_entry(results: Results, policy: str, scored: Sequence[ScoredCells]) -> Entry:
    """Make the entry of one policy from the results of a run, and its results that enter the scores."""
    summaries = {scenario: summary for (scenario, other), summary in results.summaries.items() if other == policy}
    middles = [
        Statistic(*interquartile_success((policy,), cells)) if policy in cells.cells_by_policy else UNKNOWN
        for cells in scored
    ]
    points = (results.pareto if results.scores else results.hardware_pareto).points
    cost = next((Statistic(point.cost, point.cost_ci) for point in points if point.policy == policy), UNKNOWN)
    return Entry(
        name=policy,
        policies=(policy,),
        episodes=results.episodes,
        success={name: Statistic(each.success_rate, each.success_rate_ci) for name, each in summaries.items()},
        score=_score(policy, results.scores),
        hardware_score=_score(policy, results.hardware_scores),
        interquartile_mean=middles[0],
        hardware_interquartile_mean=middles[1],
        cost=cost,
    )


def _score(policy: str, scores: Sequence[Score]) -> Statistic:
    """Return the score of a policy; UNKNOWN if it has none."""
    return next((Statistic(score.score, score.ci) for score in scores if score.policy == policy), UNKNOWN)


def _group_entry(group: SeedGroup) -> Entry:
    """Make the entry of a group of training seeds."""
    score, middle = _group_statistics(group.score)
    hardware_score, hardware_middle = _group_statistics(group.hardware_score)
    return Entry(
        name=group.name,
        policies=group.policies,
        episodes=max((rate.episodes for rate in group.scenarios.values()), default=0),
        success={name: Statistic(rate.success_rate, rate.success_rate_ci) for name, rate in group.scenarios.items()},
        score=score,
        hardware_score=hardware_score,
        interquartile_mean=middle,
        hardware_interquartile_mean=hardware_middle,
        cost=Statistic(group.cost_of_transport, group.cost_of_transport_ci),
    )


def _group_statistics(score: GroupScore | None) -> tuple[Statistic, Statistic]:
    """Return mean score and interquartile mean of a group; UNKNOWN if the group has no score."""
    if score is None:
        return UNKNOWN, UNKNOWN
    return Statistic(score.score, score.ci), Statistic(score.interquartile_mean, score.interquartile_mean_ci)
