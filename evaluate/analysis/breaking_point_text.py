"""Breaking points as people read them."""

import math

from evaluate.analysis.breaking_points import AxisBreakingPoint, Of
from evaluate.analysis.severity_levels import amount
from quad_env.cli.format import NO_BREAK

CAVEAT = (
    "An interval of a breaking point reaches from the last level shown to fail less than half the time to the first "
    "shown to fail more; between levels nothing is assumed but that more is not easier, so levels near it narrow it."
)
HALF: dict[Of, str] = {"success": "half of the episodes no longer succeed at", "falls": "half of the episodes fall at"}
"""Heads of tables, by what breaks, in their order."""


def breaking_point_text(point: AxisBreakingPoint) -> str:
    """`48 N·s [45, 51]`; `none up to 100 N·s` where less than half ever fall; `already at 20 N·s`, the mildest."""
    figure, ends = figure_and_interval(point)
    unit = amount(0.0, point.unit).removeprefix("0")
    return f"{figure}{unit} [{ends}]" if ends else f"{figure}{unit}"


def figure_and_interval(point: AxisBreakingPoint) -> tuple[str, str]:
    """The same without unit, the figure apart from its interval, `45, 51`, which is empty where there is none."""
    if point.found == "never":
        to = "up to" if point.hardest == point.highest else "down to"
        return f"none {to} {amount(point.hardest)}", ""
    if point.found == "always":
        return f"already at {amount(point.lowest if point.hardest == point.highest else point.highest)}", ""
    return f"{_digits(point.severity50):g}", _ends(point)


def ratio_text(ratio: float, ends: tuple[float, float]) -> str:
    """`1.50 times [1.31, 1.72]`; an end that could be anything is ∞ or 0."""
    low, high = (f"{end:.2f}" if 0.0 < end < math.inf else "0" if end <= 0.0 else "∞" for end in ends)
    return f"{ratio:.2f} times [{low},{NO_BREAK}{high}]"


def _ends(point: AxisBreakingPoint) -> str:
    low, high = point.ci
    lower = f"{_digits(low):g}" if math.isfinite(low) else f"<{NO_BREAK}{amount(point.lowest)}"
    upper = f"{_digits(high):g}" if math.isfinite(high) else f">{NO_BREAK}{amount(point.highest)}"
    return f"{lower},{NO_BREAK}{upper}"


def _digits(value: float) -> float:
    """Three significant digits: no interval is narrower."""
    return float(f"{value:.3g}")
