"""Figures as people read them."""

import math
import re
from collections.abc import Sequence
from decimal import ROUND_HALF_UP, Context, Decimal
from typing import NamedTuple

ABSENT = "–"
MINUS = "−"
NO_BREAK = "\u00a0"
SIGNIFICANT_DIGITS = 10
"""Digits of a figure; digits beyond them are taken for rounding errors of floats."""
_WIDE = Context(prec=400)


def number(value: float, digits: int = 3) -> str:
    """Format a figure with fixed decimals, halves away from zero, and a real minus sign; a dash if not finite."""
    if not math.isfinite(value):
        return ABSENT
    exact = Decimal(f"{value:.{SIGNIFICANT_DIGITS}g}")  # 57 of 200 are 28.5 %, in floats a little less
    text = f"{exact.quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP, _WIDE):f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


class Estimate(NamedTuple):
    """Figure and ends of its interval as text, all with the same count of decimals."""

    value: str
    low: str
    high: str

    @property
    def has_interval(self) -> bool:
        """Return whether both ends exist."""
        return ABSENT not in (self.low, self.high)

    @property
    def interval(self) -> str:
        """`low … high`; a dash if it does not exist."""
        return f"{self.low}{NO_BREAK}… {self.high}" if self.has_interval else ABSENT

    @property
    def brackets(self) -> str:
        """`[3.0, 6.8]`, which does not break; empty if it does not exist."""
        return f"[{self.low},{NO_BREAK}{self.high}]" if self.has_interval else ""

    @property
    def with_interval(self) -> str:
        """`4.2 [3.0 … 6.8]`; the figure alone without an interval."""
        return f"{self.value} [{self.interval}]" if self.has_interval else self.value


def estimate(value: float, ends: tuple[float, float], digits: int = 3, scale: float = 1.0) -> Estimate:
    """Format a figure with its interval.

    All three are rounded to the same decimals, so that a figure within its interval is shown within it.

    Args:
        value: The figure.
        ends: Lower and upper end of its interval; NaN where there is none.
        digits: Decimals; up to three more where different ends would look the same.
        scale: Factor on all three, such as 100 for per cent.
    """
    low, high = (scale * end for end in ends)
    decimals = _needed_decimals((low, high), digits)
    return Estimate(number(scale * value, decimals), number(low, decimals), number(high, decimals))


def plus_minus(value: float, ends: tuple[float, float], digits: int = 3) -> str:
    """Format `0.101 ± 0.009`: a figure and half the width of its interval, with the decimals of `estimate`.

    Args:
        value: The figure.
        ends: Lower and upper end of its interval.
        digits: Least number of decimals.
    """
    found = estimate(value, ends, digits)
    decimals = len(found.low.partition(".")[2])
    return f"{found.value} ± {number((ends[1] - ends[0]) / 2, decimals)}"


def four_digits(value: float, ends: tuple[float, float]) -> Estimate:
    """Format a figure with its interval, to four significant digits of the largest of the three."""
    largest = max((abs(each) for each in (value, *ends) if math.isfinite(each)), default=0.0)
    return estimate(value, ends, max(0, 3 - math.floor(math.log10(largest))) if largest > 0.0 else 0)


def _needed_decimals(ends: tuple[float, float], digits: int) -> int:
    """Return the decimals, or up to three more where different ends would look the same."""
    if not all(map(math.isfinite, ends)):
        return digits
    return next((d for d in range(digits, digits + 4) if number(ends[0], d) != number(ends[1], d)), digits)


def percent(share: float) -> str:
    """A share of 1 in per cent, one decimal below ten."""
    if not math.isfinite(share):
        return ABSENT
    value = 100.0 * share
    digits = 1 if 0.0 < abs(value) < 10.0 else 0
    return f"{number(value, digits)}{NO_BREAK}%"


def whole_percent(share: float) -> str:
    """Format a share in [0, 1] in whole per cent, as in `62%`."""
    return f"{number(100.0 * share, 0)}%"


def points(share: float) -> str:
    """A difference of shares in percentage points, one decimal."""
    return number(100.0 * share, 1)


def points_with(share: float, ends: tuple[float, float]) -> Estimate:
    """Format a difference of shares with its interval in percentage points, one decimal."""
    return estimate(share, ends, 1, 100.0)


def interval(ends: tuple[float, float], digits: int = 3) -> str:
    """Format an interval without its figure as `low … high`; a dash if it does not exist."""
    return estimate(ends[0], ends, digits).interval


def points_interval(ends: tuple[float, float]) -> str:
    """Format an interval without its figure as `low … high`, in percentage points, one decimal."""
    return points_with(ends[0], ends).interval


def p_value(value: float) -> str:
    """`p < 0.001`, or `p = ` with two or three decimals; its spaces do not break; a dash if it does not exist."""
    if math.isnan(value):
        return ABSENT
    if value < 0.001:
        return f"p{NO_BREAK}<{NO_BREAK}0.001"
    return f"p{NO_BREAK}={NO_BREAK}{value:.{3 if value < 0.1 else 2}f}"


def join_names(names: Sequence[str]) -> str:
    """`a, b and c`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def break_name(name: str, width: int) -> list[str]:
    """Break a name into lines of at most `width` characters, at the ends of its words.

    Words end after `/`, `_`, `-`, `:`, `@`, `+` or a space. Only a word longer than a line is broken inside, if
    possible before a capital letter.
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
    """`1 episode`, `128 episodes`."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def share(value: float, ends: tuple[float, float]) -> str:
    """`41 % [36, 47]`: a share of 1 with its interval, in whole per cent."""
    found = estimate(value, ends, 0, 100.0)
    return f"{found.value}{NO_BREAK}% {found.brackets}".rstrip()
