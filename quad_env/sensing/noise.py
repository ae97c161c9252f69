"""White noise of n robots, each from a stream of its own."""

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Rows

BLOCK = 50
"""Control steps for which a robot's noise is drawn at once."""


class Noise:
    """`deviation`, (k,), is the standard deviation of each entry.

    Drawn a block of steps at a time: that of a step depends on the robot's stream and the step alone.
    """

    def __init__(self, num_envs: int, deviation: NDArray[np.float32]) -> None:
        self._deviation = deviation
        self._noise = np.zeros((num_envs, BLOCK, len(deviation)), np.float32)
        self._block = np.full(num_envs, -1)
        """Which block of steps each robot's noise is of."""
        self._streams: list[np.random.Generator | None] = [None] * num_envs

    def begin(self, row: int, stream: np.random.Generator) -> None:
        """That robot starts an episode, whose stream this is."""
        self._block[row], self._streams[row] = -1, stream

    def at(self, clock: NDArray[np.int64], rows: Rows) -> NDArray[np.float32]:
        """Noise of those robots at these control steps since their start, which only go up, (n, k)."""
        block = clock // BLOCK
        for row in rows[self._block[rows] != block]:
            noise, stream = self._noise[row], self._streams[row]
            assert stream is not None
            stream.standard_normal(out=noise, dtype=np.float32)
            noise *= self._deviation
        self._block[rows] = block
        return self._noise[rows, clock % BLOCK]
