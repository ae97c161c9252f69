"""Breaking points of policies on axes, for falls and for success, and their text."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from evaluate.analysis.severity_levels import format_amount, severity_axes
from evaluate.cells import PolicyScenarioResult
from evaluate.statistics.breaking_point import MIN_LEVELS, BreakingPointKind, breaking_point
from evaluate.statistics.intervals import Interval
from quad_env.cli.format import NO_BREAK

FailureKind = Literal["falls", "success"]
"""Event that counts as a failure."""
FAILURE_KINDS: tuple[FailureKind, ...] = ("falls", "success")
"""Failures that define a breaking point: `falls`, half of the episodes fall; `success`, half no longer succeed."""
BREAKING_POINT_WORDS: dict[FailureKind, str] = {
    "success": "half of the episodes no longer succeed at",
    "falls": "half of the episodes fall at",
}
"""Failure -> words before the breaking points."""


@dataclass(frozen=True)
class AxisBreakingPoint:
    """Breaking point of one policy on one axis. The fields are the keys of results.json."""

    axis: str
    """Name of the axis."""
    policy: str
    """Name of the policy."""
    unit: str
    """Unit of the severities."""
    severity50: float
    """Severity at which half of the episodes fail; NaN unless crossed."""
    ci: Interval
    """95 % interval; an infinite end lies beyond the severities of the run."""
    found: BreakingPointKind
    """`crossed`; `never`: less than half fail at the hardest severity; `always`: half or more fail at the mildest."""
    lowest: float
    """Smallest severity of the run."""
    highest: float
    """Largest severity of the run."""
    hardest: float
    """The hardest of these two: the smallest friction, the largest push."""
    of: FailureKind = "falls"
    """Failure that counts: a fall, or no success."""


def breaking_points(cells: Sequence[PolicyScenarioResult]) -> list[AxisBreakingPoint]:
    """Compute the breaking points on every axis with at least three severities, falls before success."""
    cell_by_level = {(cell.scenario.name, cell.policy): cell for cell in cells}
    axes = [axis for axis in severity_axes(cells) if axis.scenarios[0].axis]
    policies = dict.fromkeys(cell.policy for cell in cells)
    points = []
    for kind, axis, policy in product(FAILURE_KINDS, axes, policies):
        levels = [cell_by_level[level.name, policy] for level in axis.levels if (level.name, policy) in cell_by_level]
        if len(levels) >= MIN_LEVELS:
            points.append(_axis_breaking_point(axis.name, levels, kind))
    return points


def _axis_breaking_point(axis: str, levels: Sequence[PolicyScenarioResult], kind: FailureKind) -> AxisBreakingPoint:
    """Compute the breaking point of one policy on one axis from its cells, the mildest severity first."""
    first = levels[0]
    mildest = levels[0].scenario
    hardest = levels[-1].scenario
    if any(not np.array_equal(cell.seeds, first.seeds) for cell in levels):
        raise ValueError(f"{first.policy} ran different episodes on the levels of {axis}: not paired")
    severities = np.array([cell.scenario.severity for cell in levels])
    failed = [cell.measures.fell if kind == "falls" else ~cell.measures.succeeded for cell in levels]
    point = breaking_point(severities, np.array(failed))
    return AxisBreakingPoint(
        axis=axis,
        policy=first.policy,
        unit=mildest.severity_unit,
        **vars(point),
        lowest=min(mildest.severity, hardest.severity),
        highest=max(mildest.severity, hardest.severity),
        hardest=hardest.severity,
        of=kind,
    )


def breaking_point_text(point: AxisBreakingPoint) -> str:
    """Format `48 N·s [45, 51]`, `none up to 100 N·s` (never half fail) or `already at 20 N·s` (mildest)."""
    is_rising = point.hardest == point.highest
    if point.found == "never":
        return f"none {'up' if is_rising else 'down'} to {format_amount(point.hardest, point.unit)}"
    if point.found == "always":
        return f"already at {format_amount(point.lowest if is_rising else point.highest, point.unit)}"
    low, high = point.ci
    lower = f"{_round_to_three_digits(low):g}" if math.isfinite(low) else f"<{NO_BREAK}{format_amount(point.lowest)}"
    upper = f"{_round_to_three_digits(high):g}" if math.isfinite(high) else f">{NO_BREAK}{format_amount(point.highest)}"
    return f"{format_amount(_round_to_three_digits(point.severity50), point.unit)} [{lower},{NO_BREAK}{upper}]"


def _round_to_three_digits(value: float) -> float:
    """Round to three significant digits, since no interval is narrower."""
    return float(f"{value:.3g}")
