"""Parts of a command's work, option `--part K/N`: N processes or machines each do one share of it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from quad_env.cli.command_line import UsageError

Item = TypeVar("Item")
MAX_PARTS = 100_000
"""Largest number of parts into which the work of a command is divided."""
_PATTERN = re.compile(r"(\d{1,6})/(\d{1,6})")


@dataclass(frozen=True, order=True)
class Part:
    """One of the equal shares into which the work of a command is divided."""

    number: int
    """Number of this part, 1 … `count`."""
    count: int
    """Number of all parts."""

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


def parse_part(text: str) -> Part:
    """Parse the value of the option --part.

    Args:
        text: Number of the part and number of all parts, such as `3/40`.

    Returns:
        The part.

    Raises:
        UsageError: The text is not of this form, or a number is out of range.
    """
    match = _PATTERN.fullmatch(text)
    part = Part(int(match[1]), int(match[2])) if match else Part(0, 0)
    if not 1 <= part.number <= part.count <= MAX_PARTS:
        raise UsageError(f"--part: no part K/N, got {text}; valid: K from 1 to N, N up to {MAX_PARTS}, such as 3/40")
    return part


def select_items(items: Sequence[Item], part: Part) -> Sequence[Item]:
    """Return the items of one part: the parts are consecutive, and their numbers of items differ by at most one."""
    count = len(items)
    return items[(part.number - 1) * count // part.count : part.number * count // part.count]
