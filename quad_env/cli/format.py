"""Figures as people read them."""

import math
import re
from collections.abc import Sequence

ABSENT = "–"
MINUS = "−"
NO_BREAK = "\u00a0"


def number(value: float, digits: int = 3) -> str:
    """A figure with a fixed count of decimals and a real minus sign; a dash if it does not exist."""
    if not math.isfinite(value):
        return ABSENT
    text = f"{value:.{digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def interval(ends: tuple[float, float], digits: int = 3) -> str:
    """`low … high`; a dash if it does not exist."""
    low, high = (number(end, _apart(ends, digits)) for end in ends)
    return ABSENT if ABSENT in (low, high) else f"{low}{NO_BREAK}… {high}"


def brackets(ends: tuple[float, float], digits: int = 1) -> str:
    """`[3.0, 6.8]`, which does not break."""
    return f"[{f',{NO_BREAK}'.join(number(end, _apart(ends, digits)) for end in ends)}]"


def _apart(ends: tuple[float, float], digits: int) -> int:
    """So many decimals, or up to three more where the ends would else seem to be the same."""
    return next((d for d in range(digits, digits + 4) if number(ends[0], d) != number(ends[1], d)), digits)


def percent(share: float) -> str:
    """A share of 1 in per cent, one decimal below ten."""
    if not math.isfinite(share):
        return ABSENT
    value = 100.0 * share
    digits = 1 if 0.0 < abs(value) < 10.0 else 0
    return f"{number(value, digits)}{NO_BREAK}%"


def points(share: float) -> str:
    """A difference of shares in percentage points, one decimal."""
    return number(100.0 * share, 1)


def points_interval(ends: tuple[float, float]) -> str:
    """`low … high` in percentage points, one decimal."""
    return interval((100.0 * ends[0], 100.0 * ends[1]), 1)


def p_value(value: float) -> str:
    """`p < 0.001`, or `p = ` with two or three decimals; its spaces do not break; a dash if it does not exist."""
    if math.isnan(value):
        return ABSENT
    if value < 0.001:
        return f"p{NO_BREAK}<{NO_BREAK}0.001"
    return f"p{NO_BREAK}={NO_BREAK}{value:.{3 if value < 0.1 else 2}f}"


def listed(names: Sequence[str]) -> str:
    """`a, b and c`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def broken(name: str, width: int) -> list[str]:
    """A name in lines of at most so many characters: broken after `/`, `_` or `-`, or where it has none of them."""
    lines = [""]
    for piece in re.findall(rf"[^/_-]{{1,{width - 1}}}[/_-]?|[/_-]", name):
        if len(lines[-1]) + len(piece) > width:
            lines.append("")
        lines[-1] += piece
    return lines


def counted(count: int, thing: str) -> str:
    """`1 episode`, `128 episodes`."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def share(value: float, ends: tuple[float, float]) -> str:
    """`41 % [36, 47]`: a share of 1 with its interval, in whole per cent."""
    return f"{number(100.0 * value, 0)}{NO_BREAK}% {brackets((100.0 * ends[0], 100.0 * ends[1]), 0)}"
