"""Rows of a recording: what they are of, and memory that two processes share for them.

What the one process has put there outlives it, however it ends.
"""

from dataclasses import dataclass
from multiprocessing.context import SpawnContext
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from live.recording.skeleton import Link
from quad_env.task.rewards import REWARD

Floats = NDArray[np.float64]
LENGTH = 6400
"""Rows that may wait: a minute of control steps, while the process that reads starts, or has to wait for its core."""


@dataclass(frozen=True)
class Source:
    """What the rows are of, a row a control step or start of an episode."""

    widths: dict[str, int]
    """Columns of each reading, in the order of a row; also `correction`, NaN of a policy that has none, and
    `start`, 1 where an episode or the recording begins."""
    joints: tuple[str, ...]
    legs: tuple[str, ...]
    links: tuple[Link, ...]
    description: str
    """URDF of the robot; empty where there is none."""
    dt: float
    """Control period, s."""

    @property
    def rewards(self) -> list[str]:
        """Readings that are terms of the reward."""
        return [name for name in self.widths if name.startswith(REWARD)]

    @property
    def slices(self) -> dict[str, slice]:
        """Reading -> its columns."""
        ends = np.cumsum(list(self.widths.values())).tolist()
        return {name: slice(end - width, end) for end, (name, width) in zip(ends, self.widths.items(), strict=True)}


class Memory(NamedTuple):
    """What is shared; goes to the other process as it starts."""

    rows: Any
    counts: Any
    """Rows that were ever put, and rows that were ever taken."""
    width: int
    """Columns of a row."""


def memory(context: SpawnContext, width: int) -> Memory:
    """Memory of a new ring; it vanishes with the last process that has it."""
    return Memory(context.RawArray("d", LENGTH * width), context.RawArray("q", 2), width)


class Ring:
    """The rows, in the order in which they are put, seen from either process."""

    def __init__(self, shared: Memory) -> None:
        self._rows = np.frombuffer(shared.rows, np.float64).reshape(-1, shared.width)
        self._counts = shared.counts

    @property
    def put(self) -> int:
        """How many rows were ever put."""
        return int(self._counts[0])

    def free_row(self) -> Floats | None:
        """The row to fill next; None while all are waiting to be taken."""
        put, taken = self._counts
        return None if put - taken >= len(self._rows) else self._rows[put % len(self._rows)]

    def put_row(self) -> None:
        """The free row is filled."""
        self._counts[0] += 1

    def take(self) -> Floats:
        """Copy of the oldest row that was put and not yet taken."""
        taken = self._counts[1]
        row: Floats = self._rows[taken % len(self._rows)].copy()
        self._counts[1] = taken + 1
        return row
