"""Breaking points as people read them."""

import math

from evaluate.analysis.breaking_points import Limit
from evaluate.analysis.severity_levels import amount
from evaluate.terminal.format import NO_BREAK


def words(limit: Limit) -> str:
    """`48 N·s [45, 51]`; `none up to 100 N·s` where less than half ever fall; `already at 20 N·s`, the mildest."""
    figure, ends = parts(limit)
    unit = amount(0.0, limit.unit).removeprefix("0")
    return f"{figure}{unit} [{ends}]" if ends else f"{figure}{unit}"


def parts(limit: Limit) -> tuple[str, str]:
    """The same without unit, the figure apart from its interval, `45, 51`, which is empty where there is none."""
    if limit.found == "never":
        to = "up to" if limit.hardest == limit.highest else "down to"
        return f"none {to} {limit.hardest:g}", ""
    if limit.found == "always":
        return f"already at {limit.lowest if limit.hardest == limit.highest else limit.highest:g}", ""
    return f"{_digits(limit.severity50):g}", _ends(limit)


def times(ratio: float, ends: tuple[float, float]) -> str:
    """`1.50 times [1.31, 1.72]`; an end that could be anything is ∞ or 0."""
    low, high = (f"{end:.2f}" if 0.0 < end < math.inf else "0" if end <= 0.0 else "∞" for end in ends)
    return f"{ratio:.2f} times [{low},{NO_BREAK}{high}]"


def _ends(limit: Limit) -> str:
    low, high = limit.ci
    lower = f"{_digits(low):g}" if math.isfinite(low) else f"<{NO_BREAK}{limit.lowest:g}"
    upper = f"{_digits(high):g}" if math.isfinite(high) else f">{NO_BREAK}{limit.highest:g}"
    return f"{lower},{NO_BREAK}{upper}"


def _digits(value: float) -> float:
    """Three significant digits: no interval is narrower."""
    return float(f"{value:.3g}")
