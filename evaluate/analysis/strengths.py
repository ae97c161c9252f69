"""Success of a policy on each disturbance axis (kind of disturbance), with the main cause of failure."""

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
    """Success of one policy on one disturbance axis, for the report's table of strengths and weaknesses.

    A disturbance axis is a kind of disturbance with several severities. If the evaluation has only one axis, the object
    describes the success at one severity of this axis.
    """

    name: str
    """Name of the disturbance axis, for example `push`.

    If the evaluation has only one axis, the text also contains the severity, for example `push at 35 N·s`.
    """
    success: float
    """Mean success rate of the policy over the severities of the disturbance axis, 0 … 1."""
    reason: str
    """Most common cause of failure with its number of episodes, for example `trip in 31 of 46 failures`.

    If no cause is known, the text names the most common outcome of a failed episode, for example `fell`. The text is
    empty if no episode failed.
    """


def strengths(
    cells: Sequence[PolicyScenarioResult],
    summaries: Mapping[tuple[str, str], Summary],
    policy: str,
    *,
    hardware: bool = False,
) -> list[Strength]:
    """Compute the success of a policy on each disturbance axis that enters its score.

    A disturbance axis is a kind of disturbance with several severities.

    Args:
        cells: Measured episodes of the evaluation, one result for each policy-scenario pair.
        summaries: (scenario name, policy name) -> rates and means over the episodes.
        policy: Name of the policy.
        hardware: True to use scenarios with the hardware profile (models of the real robot's motors and sensors), False
            to use scenarios without it.

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
    """Return the most common cause of failure as text, for example `trip in 31 of 46 failures`.

    Args:
        summaries: Summaries of one policy, one for each scenario.

    Returns:
        The text. It names the most common outcome of a failed episode if no cause is known, and is empty if no episode
        failed.
    """
    failures = sum(summary.episodes - summary.successes for summary in summaries)
    if not failures:
        return ""
    causes = sum((Counter(summary.causes) for summary in summaries), Counter[str]())
    outcomes = sum((Counter(summary.outcomes) for summary in summaries), Counter[str]())
    del outcomes[SUCCEEDED]
    ((name, count),) = (causes or outcomes).most_common(1)
    return f"{name.replace('_', ' ')} in {count} of {with_count(failures, 'failure')}"
