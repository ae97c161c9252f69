"""Breaking points of policies on axes, of falls and of success, and how people read them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from evaluate.analysis.severity_levels import amount, severity_axes
from evaluate.cells import PolicyScenarioResult
from evaluate.statistics.breaking_point import LEAST_LEVELS, Found, breaking_point
from evaluate.statistics.intervals import Interval
from quad_env.cli.format import NO_BREAK

Of = Literal["falls", "success"]
FAILURE_KINDS: tuple[Of, ...] = ("falls", "success")
"""What breaks: half of the episodes fall; half of them no longer succeed."""
HALF: dict[Of, str] = {"success": "half of the episodes no longer succeed at", "falls": "half of the episodes fall at"}
"""In words, by what breaks."""


@dataclass(frozen=True)
class AxisBreakingPoint:
    """Breaking point of one policy on one axis. The fields are the keys of results.json."""

    axis: str
    policy: str
    unit: str
    severity50: float
    """At which half of the episodes fail; NaN unless crossed."""
    ci: Interval
    """95 %; an infinite end lies beyond the severities tried."""
    found: Found
    """`crossed`; `never`: less than half fail at the hardest severity; `always`: half or more fail at the mildest."""
    lowest: float
    highest: float
    """Severities tried."""
    hardest: float
    """Which of the two is the hardest: the lowest of friction, the highest of pushes."""
    of: Of = "falls"
    """What counts as a failure: a fall, or no success."""


def breaking_points(cells: Sequence[PolicyScenarioResult]) -> list[AxisBreakingPoint]:
    """Breaking points on every axis with at least three severities; those of falls stand before those of success."""
    ran = {(cell.scenario.name, cell.policy): cell for cell in cells}
    axes = [axis for axis in severity_axes(cells) if axis.scenarios[0].axis]
    found = []
    for of, axis, policy in product(FAILURE_KINDS, axes, dict.fromkeys(cell.policy for cell in cells)):
        levels = [ran[level.name, policy] for level in axis.levels if (level.name, policy) in ran]
        if len(levels) >= LEAST_LEVELS:
            found.append(_on_axis(axis.name, levels, of))
    return found


def _on_axis(axis: str, levels: Sequence[PolicyScenarioResult], of: Of) -> AxisBreakingPoint:
    """Breaking point of one policy on that axis, from its cell at each severity, the mildest first."""
    first, mildest, hardest = levels[0], levels[0].scenario, levels[-1].scenario
    if any(not np.array_equal(cell.seeds, first.seeds) for cell in levels):
        raise ValueError(f"{first.policy} ran different episodes on the levels of {axis}: not paired")
    severities = np.array([cell.scenario.severity for cell in levels])
    failed = [cell.measures.fell if of == "falls" else ~cell.measures.succeeded for cell in levels]
    point = breaking_point(severities, np.array(failed))
    return AxisBreakingPoint(
        axis=axis,
        policy=first.policy,
        unit=mildest.severity_unit,
        **vars(point),
        lowest=min(mildest.severity, hardest.severity),
        highest=max(mildest.severity, hardest.severity),
        hardest=hardest.severity,
        of=of,
    )


def breaking_point_text(point: AxisBreakingPoint) -> str:
    """`48 N·s [45, 51]`; `none up to 100 N·s` where less than half ever fail; `already at 20 N·s`, the mildest."""
    rising = point.hardest == point.highest
    if point.found == "never":
        return f"none {'up' if rising else 'down'} to {amount(point.hardest, point.unit)}"
    if point.found == "always":
        return f"already at {amount(point.lowest if rising else point.highest, point.unit)}"
    low, high = point.ci
    lower = f"{_digits(low):g}" if math.isfinite(low) else f"<{NO_BREAK}{amount(point.lowest)}"
    upper = f"{_digits(high):g}" if math.isfinite(high) else f">{NO_BREAK}{amount(point.highest)}"
    return f"{amount(_digits(point.severity50), point.unit)} [{lower},{NO_BREAK}{upper}]"


def _digits(value: float) -> float:
    """Three significant digits: no interval is narrower."""
    return float(f"{value:.3g}")
