"""Success of a policy on each axis (kind of disturbance), with its most common cause of failure."""

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
    """Success of one policy on one axis; in a run with a single axis, its success at one severity."""

    name: str
    """Name of the axis; in a run with a single axis, the axis and one of its severities."""
    success: float
    """Mean success over the severities, 0 … 1."""
    reason: str
    """Most common cause of failure with its count, for example `trip in 31 of 46 failures`.

    It is the most common outcome if no cause is known, and empty if no episode failed.
    """


def strengths(
    cells: Sequence[PolicyScenarioResult],
    summaries: Mapping[tuple[str, str], Summary],
    policy: str,
    *,
    hardware: bool = False,
) -> list[Strength]:
    """Compute the success of a policy on each scored axis.

    Args:
        cells: Cells (episodes of one policy on one scenario) of the run.
        summaries: (scenario, policy) -> summary of the cell.
        policy: Name of the policy.
        hardware: True for axes with the hardware profile, False for axes without it.

    Returns:
        Success on each axis that the policy ran, the highest first.
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
    """Return the most common cause of failure over some cells with its count; empty without failures."""
    failures = sum(summary.episodes - summary.successes for summary in summaries)
    if not failures:
        return ""
    causes = sum((Counter(summary.causes) for summary in summaries), Counter[str]())
    outcomes = sum((Counter(summary.outcomes) for summary in summaries), Counter[str]())
    del outcomes[SUCCEEDED]
    ((name, count),) = (causes or outcomes).most_common(1)
    return f"{name.replace('_', ' ')} in {count} of {with_count(failures, 'failure')}"
