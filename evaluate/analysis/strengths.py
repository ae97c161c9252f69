"""The axes on which a policy is best and worst, and why it fails there."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from evaluate.analysis.score import counts
from evaluate.analysis.severity_levels import severity_axes
from evaluate.analysis.summary import Summary
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.rollouts.experiment import Cell


@dataclass(frozen=True)
class Strength:
    """One policy on one axis, all severities together."""

    axis: str
    success: float
    """Mean over the severities."""
    failures: int
    """Episodes"""
    reasons: tuple[tuple[str, int], ...]
    """Causes of these failures and how many have each, or their outcomes where no cause is known; most common first."""

    @property
    def reason(self) -> str:
        """`trip, 31 of 46 failures`; empty without a failure."""
        return (
            f"{self.reasons[0][0].replace('_', ' ')}, {self.reasons[0][1]} of {self.failures}" if self.reasons else ""
        )


def strengths(
    cells: Sequence[Cell], summaries: Mapping[tuple[str, str], Summary], policy: str, *, hardware: bool = False
) -> list[Strength]:
    """Every axis that the policy ran and a score counts, the most successful first."""
    found = []
    for axis in severity_axes([cell for cell in cells if cell.policy == policy and counts(cell.scenario, hardware)]):
        of = [summaries[name, policy] for name in axis.scenario_names]
        causes, outcomes = Counter[str](), Counter[str]()
        for each in of:
            causes.update(each.causes)
            outcomes.update({name: count for name, count in each.outcomes.items() if name != SUCCEEDED})
        rate = float(np.mean([summaries[level.name, policy].success_rate for level in axis.levels]))
        reasons = [(name, count) for name, count in (causes or outcomes).most_common() if count]
        found.append(Strength(axis.name, rate, sum(each.episodes - each.successes for each in of), tuple(reasons)))
    return sorted(found, key=lambda each: -each.success)
