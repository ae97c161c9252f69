"""Formatting of numbers, fractions, confidence intervals and names as text."""

import math
import re
from collections.abc import Sequence
from decimal import ROUND_HALF_UP, Context, Decimal
from typing import NamedTuple

ABSENT = "–"
"""Text of a missing value."""
MINUS = "−"
"""Minus sign."""
NO_BREAK = "\u00a0"
"""Non-breaking space."""
SIGNIFICANT_DIGITS = 10
"""Number of significant digits to which a float is rounded first, to remove its floating-point error."""
_WIDE = Context(prec=400)
"""Decimal context with enough digits to represent every float."""


def number(value: float, digits: int = 3) -> str:
    """Format a number with a fixed number of decimals; a dash if it is not finite.

    Halves are rounded away from zero, and the minus sign is the character MINUS.

    Args:
        value: The number.
        digits: Number of decimals.

    Returns:
        The text.
    """
    if not math.isfinite(value):
        return ABSENT
    # Remove the floating-point error first: 57 of 200 are 28.5 %, but the float is slightly less and would round down.
    exact = Decimal(f"{value:.{SIGNIFICANT_DIGITS}g}")
    text = f"{exact.quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP, _WIDE):f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


class Estimate(NamedTuple):
    """A number and the ends of its interval as texts with the same number of decimals; made by `estimate`."""

    value: str
    low: str
    high: str

    @property
    def has_interval(self) -> bool:
        """True if both ends of the interval are finite."""
        return ABSENT not in (self.low, self.high)

    @property
    def interval(self) -> str:
        """Interval as `low … high`; a dash if there is no interval."""
        return f"{self.low}{NO_BREAK}… {self.high}" if self.has_interval else ABSENT

    @property
    def brackets(self) -> str:
        """Interval as `[3.0, 6.8]` with a non-breaking space; empty if there is no interval."""
        return f"[{self.low},{NO_BREAK}{self.high}]" if self.has_interval else ""

    @property
    def with_interval(self) -> str:
        """Number and interval as `4.2 [3.0 … 6.8]`; only the number if there is no interval."""
        return f"{self.value} [{self.interval}]" if self.has_interval else self.value


def estimate(value: float, ends: tuple[float, float], digits: int = 3, scale: float = 1.0) -> Estimate:
    """Format a number with its interval.

    The number and both ends have the same number of decimals, so that rounding never puts the number outside of the
    interval.

    Args:
        value: The number.
        ends: Lower and upper end of the interval; NaN if there is no interval.
        digits: Number of decimals; up to three more are used if different ends would look equal.
        scale: Factor on the number and both ends, such as 100 for per cent.

    Returns:
        The texts of the number and both ends.
    """
    low, high = (scale * end for end in ends)
    decimals = _needed_decimals((low, high), digits)
    return Estimate(number(scale * value, decimals), number(low, decimals), number(high, decimals))


def plus_minus(value: float, ends: tuple[float, float], digits: int = 3) -> str:
    """Format a number and half the width of its interval as `0.101 ± 0.009`.

    Args:
        value: The number.
        ends: Lower and upper end of the interval.
        digits: Minimum number of decimals, see `estimate`.

    Returns:
        The text.
    """
    text = estimate(value, ends, digits)
    decimals = len(text.low.partition(".")[2])
    return f"{text.value} ± {number((ends[1] - ends[0]) / 2, decimals)}"


def four_digits(value: float, ends: tuple[float, float]) -> Estimate:
    """Format `value` and the `ends` of its interval; the largest number has four significant digits."""
    largest = max((abs(each) for each in (value, *ends) if math.isfinite(each)), default=0.0)
    return estimate(value, ends, max(0, 3 - math.floor(math.log10(largest))) if largest > 0.0 else 0)


def _needed_decimals(ends: tuple[float, float], digits: int) -> int:
    """Return the number of decimals for an interval.

    Args:
        ends: Lower and upper end of the interval.
        digits: Minimum number of decimals.

    Returns:
        `digits`, or up to three more if different ends would look equal.
    """
    if not all(map(math.isfinite, ends)):
        return digits
    return next((d for d in range(digits, digits + 4) if number(ends[0], d) != number(ends[1], d)), digits)


def percent(share: float) -> str:
    """Format a fraction in [0, 1] in per cent, with one decimal below 10 %."""
    if not math.isfinite(share):
        return ABSENT
    value = 100.0 * share
    digits = 1 if 0.0 < abs(value) < 10.0 else 0
    return f"{number(value, digits)}{NO_BREAK}%"


def whole_percent(share: float) -> str:
    """Format a fraction in [0, 1] in whole per cent, as `62%`."""
    return f"{number(100.0 * share, 0)}%"


def points(share: float) -> str:
    """Format a difference of fractions in percentage points, with one decimal."""
    return number(100.0 * share, 1)


def points_with(share: float, ends: tuple[float, float]) -> Estimate:
    """Format a difference of fractions and its interval in percentage points, with one decimal.

    `share` is the difference, and `ends` are the ends of its interval.

    Args:
        share: Difference of fractions.
        ends: Ends of the interval.

    Returns:
        The text.
    """
    return estimate(share, ends, 1, 100.0)


def interval(ends: tuple[float, float], digits: int = 3) -> str:
    """Format the `ends` of an interval as `low … high`; a dash if an end is NaN.

    At least `digits` decimals are used.

    Args:
        ends: Lower and upper end.
        digits: Smallest number of decimals.

    Returns:
        The text.
    """
    return estimate(ends[0], ends, digits).interval


def points_interval(ends: tuple[float, float]) -> str:
    """Format an interval as `low … high` in percentage points, with one decimal."""
    return points_with(ends[0], ends).interval


def p_value(value: float) -> str:
    """Format a p-value as `p < 0.001`, or as `p = ` with two or three decimals; a dash if it is NaN."""
    if math.isnan(value):
        return ABSENT
    if value < 0.001:
        return f"p{NO_BREAK}<{NO_BREAK}0.001"
    return f"p{NO_BREAK}={NO_BREAK}{value:.{3 if value < 0.1 else 2}f}"


def join_names(names: Sequence[str]) -> str:
    """Join names as `a, b and c`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def break_name(name: str, width: int) -> list[str]:
    """Break a name into lines at the ends of its words.

    Words end after `/`, `_`, `-`, `:`, `@`, `+` or a space. A word longer than a line is broken before a capital letter
    if possible.

    Args:
        name: The name.
        width: Largest number of characters of a line.

    Returns:
        The lines.
    """
    lines = [""]
    for word in re.findall(r"[^/_\-:@+ ]*[/_\-:@+ ]|[^/_\-:@+ ]+", name):
        parts = [word] if len(word) <= width else re.split(r"(?<=[a-z0-9])(?=[A-Z])", word)
        for piece in (piece for part in parts for piece in re.findall(f".{{1,{width}}}", part)):
            if len(lines[-1]) + len(piece) > width:
                lines.append("")
            lines[-1] += piece
    return lines


def with_count(count: int, thing: str) -> str:
    """Format a count with its noun: `1 episode` or `128 episodes` for the `thing` `episode`."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def share(value: float, ends: tuple[float, float]) -> str:
    """Format a fraction and its interval in whole per cent, as `41 % [36, 47]`.

    `value` is the fraction in [0, 1], and `ends` are the ends of its interval.

    Args:
        value: Fraction in [0, 1].
        ends: Ends of the interval.

    Returns:
        The text.
    """
    text = estimate(value, ends, 0, 100.0)
    return f"{text.value}{NO_BREAK}% {text.brackets}".rstrip()
