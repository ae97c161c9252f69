"""Logs of bounded length that take any number of robots' entries at once."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Ring:
    """The latest `capacity` rows of `width` whole numbers."""

    def __init__(self, width: int, capacity: int) -> None:
        self._rows = np.zeros((capacity, width), np.int64)
        self.total = 0
        """Rows ever written."""

    def write(self, *columns: ArrayLike) -> None:
        """Append rows, one column an argument; a single number stands for a whole column."""
        rows = np.stack(np.broadcast_arrays(*map(np.atleast_1d, columns)), axis=-1)
        capacity = len(self._rows)
        kept = rows[-capacity:]
        first = self.total + len(rows) - len(kept)
        self._rows[(first + np.arange(len(kept))) % capacity] = kept
        self.total += len(rows)

    def read(self) -> NDArray[np.int64]:
        """The rows still held, oldest first, as a copy."""
        capacity = len(self._rows)
        return self._rows[np.arange(max(self.total - capacity, 0), self.total) % capacity]
