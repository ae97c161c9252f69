"""Success of a policy on each disturbance axis, with the most common cause of its failures."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from evaluate.analysis.score import is_scored
from evaluate.analysis.severity_levels import format_scenario, severity_axes
from evaluate.analysis.summary import Summary
from evaluate.cells import PolicyScenarioResult
from evaluate.measures.outcomes import SUCCEEDED
from quad_env.cli.format import with_count


@dataclass(frozen=True)
class Strength:
    """Success of one policy on one disturbance axis, for the table of best and worst axes.

    In a run with a single axis, it is the success at one severity of this axis.
    """

    name: str
    """Name of the disturbance axis; in a run with a single axis, also one of its severities."""
    success: float
    """Mean success rate over the severities of the axis, 0 … 1."""
    reason: str
    """Most common cause of failure with its count, for example `trip in 31 of 46 failures`.

    The text has the most common outcome if no cause is known. It is empty if no episode failed.
    """


def strengths(
    cells: Sequence[PolicyScenarioResult],
    summaries: Mapping[tuple[str, str], Summary],
    policy: str,
    *,
    hardware: bool = False,
) -> list[Strength]:
    """Compute the success of a policy on each scored disturbance axis.

    Args:
        cells: Results of the run, one for each pair of policy and scenario.
        summaries: (scenario name, policy name) -> rates and means over the episodes.
        policy: Name of the policy.
        hardware: True for scenarios with the hardware profile, False for scenarios without it.

    Returns:
        Success on each disturbance axis that the policy ran, the highest first.
    """
    axes = severity_axes([cell for cell in cells if cell.policy == policy and is_scored(cell.scenario, hardware)])
    groups = [(axis.name, axis.levels) for axis in axes]
    if len(axes) == 1:
        groups = [(format_scenario(level), (level,)) for level in axes[0].levels]
    on_axes = []
    for name, levels in groups:
        level_summaries = [summaries[level.name, policy] for level in levels]
        success = float(np.mean([summary.success_rate for summary in level_summaries]))
        on_axes.append(Strength(name, success, _reason(level_summaries)))
    return sorted(on_axes, key=lambda strength: -strength.success)


def _reason(summaries: Sequence[Summary]) -> str:
    """Return the most common cause of failure in `summaries` with its count; empty if no episode failed."""
    failures = sum(summary.episodes - summary.successes for summary in summaries)
    if not failures:
        return ""
    causes = sum((Counter(summary.causes) for summary in summaries), Counter[str]())
    outcomes = sum((Counter(summary.outcomes) for summary in summaries), Counter[str]())
    del outcomes[SUCCEEDED]
    ((name, count),) = (causes or outcomes).most_common(1)
    return f"{name.replace('_', ' ')} in {count} of {with_count(failures, 'failure')}"
