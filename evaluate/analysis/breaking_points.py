"""Breaking points of all policies on all disturbance axes, and their formatting as text.

A disturbance axis is a kind of disturbance, for example pushes, that is tested at several severities. A breaking point
is the severity at which half of the episodes of a policy fail.
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
"""Kind of failure that a breaking point counts.

A breaking point is the severity of a disturbance at which half of the episodes fail. `falls` counts episodes in which
the robot falls. `success` counts all episodes that do not succeed by the success rule.
"""
FAILURE_KINDS: tuple[FailureKind, ...] = ("falls", "success")
"""All kinds of failure for which breaking points are computed: falls, and episodes without success.

Each policy has one breaking point for each kind of failure and each kind of disturbance.
"""
BREAKING_POINT_WORDS: dict[FailureKind, str] = {
    "success": "half of the episodes no longer succeed at",
    "falls": "half of the episodes fall at",
}
"""Kind of failure -> words that are printed before the severities at which half of the episodes fail."""


@dataclass(frozen=True)
class AxisBreakingPoint:
    """Breaking point: severity of a disturbance at which half of the episodes of one policy fail.

    The field names are the keys in results.json.
    """

    axis: str
    """Name of the disturbance axis (kind of disturbance with several severities), for example `push`."""
    policy: str
    """Name of the policy that has this breaking point."""
    unit: str
    """Unit of the severities on this disturbance axis, for example `N·s`; empty if the severities have none."""
    severity50: float
    """Severity at which half of the episodes fail, in `unit`; NaN if `found` is `never` or `always`."""
    ci: Interval
    """95 % confidence interval of `severity50`, in `unit`; an end beyond the tested range is infinite."""
    found: BreakingPointKind
    """Result of the search for the severity at which half of the episodes fail.

    `crossed`: the failure rate crosses one half between the mildest and the hardest severity. `never`: less than half
    fail at the hardest severity. `always`: half or more fail at the mildest severity.
    """
    lowest: float
    """Smallest severity of the disturbance at which the policy was tested, in `unit`."""
    highest: float
    """Largest severity of the disturbance at which the policy was tested, in `unit`."""
    hardest: float
    """Hardest severity of the disturbance at which the policy was tested, in `unit`.

    It equals `lowest` if a smaller value is harder, as with a friction coefficient. Otherwise it equals `highest`, as
    with the impulse of a push.
    """
    of: FailureKind = "falls"
    """Kind of failure that is counted: `falls`, or all episodes without success (`success`)."""


def breaking_points(cells: Sequence[PolicyScenarioResult]) -> list[AxisBreakingPoint]:
    """Compute the breaking points of every policy on each disturbance axis with enough severities.

    A breaking point is the severity of a disturbance, for example pushes, at which half of the episodes fail. It is
    computed only if the disturbance was tested at MIN_LEVELS severities or more.

    Args:
        cells: Measured episodes of an evaluation, one result for each policy-scenario pair.

    Returns:
        Breaking points that count falls, then breaking points that count all failures. Both are sorted by disturbance
        axis and then by policy.
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
    """Compute the severity of one disturbance at which half of the episodes of one policy fail.

    Args:
        axis: Name of the disturbance axis, for example `push`.
        levels: Result of the policy at each severity of the axis, the mildest first.
        kind: Kind of failure to count: `falls`, or all episodes without success (`success`).

    Returns:
        The breaking point with its confidence interval.

    Raises:
        ValueError: The episodes at two severities have different seeds.
    """
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
    """Format a breaking point as text, such as `48 N·s [45, 51]`.

    A breaking point is the severity at which half of the episodes fail. The brackets contain its 95 % interval. The
    text is `none up to 100 N·s` if less than half of the episodes fail at the hardest severity. It is
    `already at 20 N·s` if half or more fail at the mildest severity.
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
    """Round a severity to three significant digits; its confidence interval is wider than the error."""
    return float(f"{value:.3g}")
