"""Numbers, shares, intervals and names as text for people."""

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
"""Space at which no line breaks."""
SIGNIFICANT_DIGITS = 10
"""Significant digits of a number; digits beyond them count as rounding errors of floats."""
_WIDE = Context(prec=400)
"""Decimal context in which no float loses a digit."""


def number(value: float, digits: int = 3) -> str:
    """Format a number with fixed decimals, halves away from zero, and a real minus sign; a dash if not finite.

    Args:
        value: The number.
        digits: Decimals.

    Returns:
        The text.
    """
    if not math.isfinite(value):
        return ABSENT
    exact = Decimal(f"{value:.{SIGNIFICANT_DIGITS}g}")  # 57 of 200 are 28.5 %, in floats a little less
    text = f"{exact.quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP, _WIDE):f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


class Estimate(NamedTuple):
    """Number and ends of its interval as text, all with the same number of decimals; made by `estimate`."""

    value: str
    low: str
    high: str

    @property
    def has_interval(self) -> bool:
        """True if both ends exist."""
        return ABSENT not in (self.low, self.high)

    @property
    def interval(self) -> str:
        """Interval as `low … high`; a dash if it does not exist."""
        return f"{self.low}{NO_BREAK}… {self.high}" if self.has_interval else ABSENT

    @property
    def brackets(self) -> str:
        """Interval as `[3.0, 6.8]` without a line break; empty if it does not exist."""
        return f"[{self.low},{NO_BREAK}{self.high}]" if self.has_interval else ""

    @property
    def with_interval(self) -> str:
        """Number and interval as `4.2 [3.0 … 6.8]`; the number alone without an interval."""
        return f"{self.value} [{self.interval}]" if self.has_interval else self.value


def estimate(value: float, ends: tuple[float, float], digits: int = 3, scale: float = 1.0) -> Estimate:
    """Format a number with its interval.

    All three are rounded to the same decimals, so that a number within its interval is shown within it.

    Args:
        value: The number.
        ends: Lower and upper end of its interval; NaN where there is none.
        digits: Decimals; up to three more where different ends would look the same.
        scale: Factor on all three, as 100 for per cent.

    Returns:
        The texts of number and interval.
    """
    low, high = (scale * end for end in ends)
    decimals = _needed_decimals((low, high), digits)
    return Estimate(number(scale * value, decimals), number(low, decimals), number(high, decimals))


def plus_minus(value: float, ends: tuple[float, float], digits: int = 3) -> str:
    """Format `0.101 ± 0.009`: a number and half the width of its interval, with the decimals of `estimate`.

    Args:
        value: The number.
        ends: Lower and upper end of its interval.
        digits: Least number of decimals.

    Returns:
        The text.
    """
    text = estimate(value, ends, digits)
    decimals = len(text.low.partition(".")[2])
    return f"{text.value} ± {number((ends[1] - ends[0]) / 2, decimals)}"


def four_digits(value: float, ends: tuple[float, float]) -> Estimate:
    """Format `value` and the `ends` of its interval, to four significant digits of the largest of the three."""
    largest = max((abs(each) for each in (value, *ends) if math.isfinite(each)), default=0.0)
    return estimate(value, ends, max(0, 3 - math.floor(math.log10(largest))) if largest > 0.0 else 0)


def _needed_decimals(ends: tuple[float, float], digits: int) -> int:
    """Return the decimals, or up to three more where different ends would look the same."""
    if not all(map(math.isfinite, ends)):
        return digits
    return next((d for d in range(digits, digits + 4) if number(ends[0], d) != number(ends[1], d)), digits)


def percent(share: float) -> str:
    """Format a share in [0, 1] in per cent, with one decimal below ten."""
    if not math.isfinite(share):
        return ABSENT
    value = 100.0 * share
    digits = 1 if 0.0 < abs(value) < 10.0 else 0
    return f"{number(value, digits)}{NO_BREAK}%"


def whole_percent(share: float) -> str:
    """Format a share in [0, 1] in whole per cent, as in `62%`."""
    return f"{number(100.0 * share, 0)}%"


def points(share: float) -> str:
    """Format a difference of shares in percentage points, with one decimal."""
    return number(100.0 * share, 1)


def points_with(share: float, ends: tuple[float, float]) -> Estimate:
    """Format a difference `share` of shares and the `ends` of its interval in percentage points, with one decimal."""
    return estimate(share, ends, 1, 100.0)


def interval(ends: tuple[float, float], digits: int = 3) -> str:
    """Format the `ends` of an interval as `low … high` with at least `digits` decimals; a dash if it does not exist."""
    return estimate(ends[0], ends, digits).interval


def points_interval(ends: tuple[float, float]) -> str:
    """Format an interval as `low … high` in percentage points, with one decimal."""
    return points_with(ends[0], ends).interval


def p_value(value: float) -> str:
    """Format `p < 0.001`, or `p = ` with two or three decimals, without line breaks; a dash if it does not exist."""
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

    Words end after `/`, `_`, `-`, `:`, `@`, `+` or a space. Only a word longer than a line is broken inside, if
    possible before a capital letter.

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
    """Return `1 episode` for a `count` of 1 and the `thing` `episode`, else `128 episodes`."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def share(value: float, ends: tuple[float, float]) -> str:
    """Format a share `value` in [0, 1] and the `ends` of its interval in whole per cent, as `41 % [36, 47]`."""
    text = estimate(value, ends, 0, 100.0)
    return f"{text.value}{NO_BREAK}% {text.brackets}".rstrip()
