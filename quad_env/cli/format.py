"""Formatting of numbers, fractions, confidence intervals, p-values and names as text for reports."""

import math
import re
from collections.abc import Sequence
from decimal import ROUND_HALF_UP, Context, Decimal
from typing import NamedTuple

ABSENT = "–"
"""Text in place of a number that is NaN or infinite, or does not exist: a dash."""
MINUS = "−"
"""Typographic minus sign, which replaces the hyphen in formatted numbers."""
NO_BREAK = "\u00a0"
"""Non-breaking space, which keeps a number and its unit on one line."""
SIGNIFICANT_DIGITS = 10
"""Number of significant digits to which `number` rounds a float before it rounds to decimals.

The first rounding removes the floating-point error, because of which some halves would be rounded down.
"""
_WIDE = Context(prec=400)
"""Decimal context with 400 digits, which are enough to write the largest float with decimals."""


def number(value: float, digits: int = 3) -> str:
    """Format a number with a fixed number of decimals; a dash if the number is not finite.

    Halves are rounded away from zero, and the minus sign is the character MINUS.

    Args:
        value: The number.
        digits: Number of decimals.

    Returns:
        The text.
    """
    if not math.isfinite(value):
        return ABSENT
    # The floating-point error is removed first: 57 of 200 are 28.5 %, but the float is slightly less, and so would be
    # rounded down.
    exact = Decimal(f"{value:.{SIGNIFICANT_DIGITS}g}")
    text = f"{exact.quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP, _WIDE):f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


class Estimate(NamedTuple):
    """A number and its confidence interval as texts with the same number of decimals; made by `estimate`."""

    value: str
    """Text of the number."""
    low: str
    """Text of the lower end of the interval; a dash if there is none."""
    high: str
    """Text of the upper end of the interval; a dash if there is none."""

    @property
    def has_interval(self) -> bool:
        """True if the number has an interval with two finite ends."""
        return ABSENT not in (self.low, self.high)

    @property
    def interval(self) -> str:
        """Text of the interval as `3.0 … 6.8`; a dash if there is no interval."""
        return f"{self.low}{NO_BREAK}… {self.high}" if self.has_interval else ABSENT

    @property
    def brackets(self) -> str:
        """Text of the interval as `[3.0, 6.8]`, with a non-breaking space; empty if there is no interval."""
        return f"[{self.low},{NO_BREAK}{self.high}]" if self.has_interval else ""

    @property
    def with_interval(self) -> str:
        """Text of the number and the interval as `4.2 [3.0 … 6.8]`; only the number if there is no interval."""
        return f"{self.value} [{self.interval}]" if self.has_interval else self.value


def estimate(value: float, ends: tuple[float, float], digits: int = 3, scale: float = 1.0) -> Estimate:
    """Format a number with its confidence interval.

    The number and both ends get the same number of decimals, so that rounding never puts the number outside of the
    interval.

    Args:
        value: The number.
        ends: Lower and upper end of the interval; NaN if there is no interval.
        digits: Number of decimals; up to three more are used if different ends would look equal.
        scale: Factor on the number and both ends, such as 100 to show a fraction in per cent.

    Returns:
        Texts of the number and of both ends.
    """
    low, high = (scale * end for end in ends)
    decimals = _needed_decimals((low, high), digits)
    return Estimate(number(scale * value, decimals), number(low, decimals), number(high, decimals))


def plus_minus(value: float, ends: tuple[float, float], digits: int = 3) -> str:
    """Format a number and half the width of its confidence interval as `0.101 ± 0.009`.

    Args:
        value: The number.
        ends: Lower and upper end of the interval.
        digits: Minimum number of decimals; up to three more are used if different ends would look equal.

    Returns:
        The text.
    """
    text = estimate(value, ends, digits)
    decimals = len(text.low.partition(".")[2])
    return f"{text.value} ± {number((ends[1] - ends[0]) / 2, decimals)}"


def four_digits(value: float, ends: tuple[float, float]) -> Estimate:
    """Format a number and its confidence interval so that the largest of the three has four digits.

    Args:
        value: The number.
        ends: Lower and upper end of the interval.

    Returns:
        Texts of the number and of both ends, with the same number of decimals.
    """
    largest = max((abs(each) for each in (value, *ends) if math.isfinite(each)), default=0.0)
    return estimate(value, ends, max(0, 3 - math.floor(math.log10(largest))) if largest > 0.0 else 0)


def _needed_decimals(ends: tuple[float, float], digits: int) -> int:
    """Return the number of decimals with which the ends of an interval look different.

    Args:
        ends: Lower and upper end of the interval.
        digits: Minimum number of decimals.

    Returns:
        `digits`, or up to three more if the ends differ but would look equal.
    """
    if not all(map(math.isfinite, ends)):
        return digits
    return next((d for d in range(digits, digits + 4) if number(ends[0], d) != number(ends[1], d)), digits)


def percent(share: float) -> str:
    """Format the fraction `share`, 0 to 1, in per cent: one decimal below 10 %, otherwise none; a dash for NaN."""
    if not math.isfinite(share):
        return ABSENT
    value = 100.0 * share
    digits = 1 if 0.0 < abs(value) < 10.0 else 0
    return f"{number(value, digits)}{NO_BREAK}%"


def whole_percent(share: float) -> str:
    """Format the fraction `share`, 0 to 1, in whole per cent without a space, as `62%`."""
    return f"{number(100.0 * share, 0)}%"


def points(share: float) -> str:
    """Format the difference of two fractions, `share`, -1 to 1, in percentage points, with one decimal."""
    return number(100.0 * share, 1)


def points_with(share: float, ends: tuple[float, float]) -> Estimate:
    """Format the difference of two fractions and its interval in percentage points, with one decimal.

    Args:
        share: Difference of the fractions, -1 to 1.
        ends: Lower and upper end of its confidence interval, -1 to 1.

    Returns:
        Texts of the difference and of both ends, percentage points.
    """
    return estimate(share, ends, 1, 100.0)


def interval(ends: tuple[float, float], digits: int = 3) -> str:
    """Format an interval as `0.125 … 0.250`; a dash if an end is NaN.

    Args:
        ends: Lower and upper end of the interval.
        digits: Minimum number of decimals; up to three more are used if different ends would look equal.

    Returns:
        The text.
    """
    return estimate(ends[0], ends, digits).interval


def points_interval(ends: tuple[float, float]) -> str:
    """Format the interval `ends` of a difference of fractions, -1 to 1, in percentage points, as `1.5 … 4.0`."""
    return points_with(ends[0], ends).interval


def p_value(value: float) -> str:
    """Format the p-value `value` as `p < 0.001`, `p = 0.012` or `p = 0.25`; a dash if it is NaN."""
    if math.isnan(value):
        return ABSENT
    if value < 0.001:
        return f"p{NO_BREAK}<{NO_BREAK}0.001"
    return f"p{NO_BREAK}={NO_BREAK}{value:.{3 if value < 0.1 else 2}f}"


def join_names(names: Sequence[str]) -> str:
    """Join at least one name to a text such as `a, b and c`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def break_name(name: str, width: int) -> list[str]:
    """Break a long name of a policy or scenario into lines, at the ends of its words.

    Words end after `/`, `_`, `-`, `:`, `@`, `+` or a space. A word that is longer than a line is broken before a
    capital letter if possible.

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
    """Format a count with a noun in singular or plural, such as `1 episode` or `128 episodes`.

    Args:
        count: Number of things.
        thing: Noun in the singular, such as `episode`; the plural must end in `s`.

    Returns:
        The text.
    """
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def share(value: float, ends: tuple[float, float]) -> str:
    """Format a fraction and its confidence interval in whole per cent, as `41 % [36, 47]`.

    Args:
        value: The fraction, 0 to 1.
        ends: Lower and upper end of the interval, 0 to 1; NaN if there is no interval.

    Returns:
        The text.
    """
    text = estimate(value, ends, 0, 100.0)
    return f"{text.value}{NO_BREAK}% {text.brackets}".rstrip()
