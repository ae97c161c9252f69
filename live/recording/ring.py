"""Rows of numbers in memory that two processes share: what the one has put there outlives it, however it ends."""

from multiprocessing.context import SpawnContext
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
LENGTH = 6400
"""Rows that may wait: a minute of control steps, while the process that reads starts, or has to wait for its core."""


class Memory(NamedTuple):
    """What is shared; goes to the other process as it starts."""

    rows: Any
    counts: Any
    """Rows that were ever put, and rows that were ever taken."""


def memory(context: SpawnContext, width: int) -> Memory:
    """Memory of a new ring; it vanishes with the last process that has it."""
    return Memory(context.RawArray("d", LENGTH * width), context.RawArray("q", 2))


class Ring:
    """The rows, in the order in which they are put, seen from either process."""

    def __init__(self, shared: Memory) -> None:
        self._rows = np.frombuffer(shared.rows, np.float64).reshape(LENGTH, -1)
        self._counts = shared.counts

    @property
    def put(self) -> int:
        """How many rows were ever put."""
        return int(self._counts[0])

    def free_row(self) -> Floats | None:
        """The row to fill next; None while all are waiting to be taken."""
        put, taken = self._counts
        return None if put - taken >= LENGTH else self._rows[put % LENGTH]

    def put_row(self) -> None:
        """The free row is filled."""
        self._counts[0] += 1

    def take(self, until: int) -> Floats:
        """Copies of the rows that were put until there were so many, and not yet taken."""
        taken = self._counts[1]
        rows: Floats = self._rows[np.arange(taken, until) % LENGTH]
        self._counts[1] = until
        return rows
