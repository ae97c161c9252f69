"""Breaking points of all policies on all axes, for falls and for success, and their display as text.

An axis is a kind of disturbance with several severities. A breaking point is the severity at which half of the episodes
fail.
"""

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
"""Kind of failure that a breaking point counts: `falls`, or episodes without success (`success`)."""
FAILURE_KINDS: tuple[FailureKind, ...] = ("falls", "success")
"""All kinds of failure; each policy has a breaking point for each kind on each axis."""
BREAKING_POINT_WORDS: dict[FailureKind, str] = {
    "success": "half of the episodes no longer succeed at",
    "falls": "half of the episodes fall at",
}
"""Kind of failure -> printed words before the breaking points."""


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
    """Severity at which half of the episodes fail; NaN if `found` is `never` or `always`."""
    ci: Interval
    """95 % interval of the severity; an end is infinite if it lies beyond the severities of the run."""
    found: BreakingPointKind
    """Where the failure rate crosses one half.

    `crossed`: between the mildest and the hardest severity. `never`: less than half fail at the hardest severity.
    `always`: half or more fail at the mildest severity.
    """
    lowest: float
    """Smallest severity of the run."""
    highest: float
    """Largest severity of the run."""
    hardest: float
    """Hardest severity of the run: `lowest` on an axis like friction, `highest` on an axis like push."""
    of: FailureKind = "falls"
    """Kind of failure that counts."""


def breaking_points(cells: Sequence[PolicyScenarioResult]) -> list[AxisBreakingPoint]:
    """Compute the breaking points of every policy on every axis with at least MIN_LEVELS severities.

    Args:
        cells: Cells of a run. A cell holds the episodes of one policy on one scenario.

    Returns:
        Breaking points for falls, then for success, each sorted by axis and then by policy.
    """
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
    """Compute the breaking point of one policy on one axis from its cells, the mildest first."""
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
    """Format a breaking point as text.

    The text is `48 N·s [45, 51]` if the failure rate crosses one half. It is `none up to 100 N·s` if less than half of
    the episodes fail at the hardest severity. It is `already at 20 N·s` if half or more fail at the mildest severity.
    """
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
    """Round to three significant digits, because every interval is wider than the rounding error."""
    return float(f"{value:.3g}")
