"""Success of a policy by axis, with the most common cause of its failures there."""

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
    """Success of one policy on one axis over all severities, or at one severity in a run of one axis."""

    name: str
    """Name of the axis, or of its severity."""
    success: float
    """Mean success over the severities."""
    reason: str
    """Most common cause of failure, or outcome if no cause is known: `trip in 31 of 46 failures`; may be empty."""


def strengths(
    cells: Sequence[PolicyScenarioResult],
    summaries: Mapping[tuple[str, str], Summary],
    policy: str,
    *,
    hardware: bool = False,
) -> list[Strength]:
    """Compute the success of a policy on each scored axis.

    Args:
        cells: Cells of the run.
        summaries: (scenario, policy) -> figures.
        policy: Name of the policy.
        hardware: Whether to take the axes with the hardware profile.

    Returns:
        Axes that the policy ran, the most successful first.
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
    """Return the most common cause of failure over some cells, with its count."""
    failures = sum(summary.episodes - summary.successes for summary in summaries)
    if not failures:
        return ""
    causes = sum((Counter(summary.causes) for summary in summaries), Counter[str]())
    outcomes = sum((Counter(summary.outcomes) for summary in summaries), Counter[str]())
    del outcomes[SUCCEEDED]
    ((name, count),) = (causes or outcomes).most_common(1)
    return f"{name.replace('_', ' ')} in {count} of {with_count(failures, 'failure')}"
