"""Figures as people read them."""

import math

from evaluate.statistics import Interval

ABSENT = "–"
MINUS = "−"


def number(value: float, digits: int = 3) -> str:
    """A figure with a fixed count of decimals and a real minus sign; a dash if it does not exist."""
    if not math.isfinite(value):
        return ABSENT
    text = f"{value:.{digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def interval(ends: Interval, digits: int = 3) -> str:
    """`low … high`; a dash if it does not exist."""
    low, high = ends
    return f"{number(low, digits)} … {number(high, digits)}" if math.isfinite(low) and math.isfinite(high) else ABSENT


def percent(share: float) -> str:
    """A share of 1 in per cent, one decimal below ten."""
    if not math.isfinite(share):
        return ABSENT
    value = 100.0 * share
    digits = 1 if 0.0 < abs(value) < 10.0 else 0
    return f"{number(value, digits)} %"


def percent_interval(ends: Interval) -> str:
    """`low … high %`, one decimal."""
    low, high = ends
    return f"{number(100 * low, 1)} … {number(100 * high, 1)} %" if math.isfinite(low) else ABSENT


def p_value(value: float) -> str:
    """`p < 0.001`, or `p = ` with two significant digits."""
    if value < 0.001:
        return "p < 0.001"
    return f"p = {value:.3f}" if value < 0.1 else f"p = {value:.2f}"
