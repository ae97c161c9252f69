"""Description of the recorded rows, for the process that writes them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from live.recording.skeleton import Link
from quad_env.task.rewards import REWARD

Rows = NDArray[np.float64]
"""A row a control step, or start of an episode, of the columns that `Source` names, (n, width)."""


@dataclass(frozen=True)
class Source:
    """What the recorded rows are of."""

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
    command_steps: int
    """Control steps that a drawn command lasts."""

    @property
    def rewards(self) -> tuple[str, ...]:
        """Names of the terms of the reward."""
        return tuple(name.removeprefix(REWARD) for name in self.widths if name.startswith(REWARD))

    @property
    def width(self) -> int:
        """Columns of a row."""
        return sum(self.widths.values())

    def columns(self, rows: Rows) -> dict[str, Rows]:
        """Reading -> its columns, (n, k)."""
        ends = np.cumsum(list(self.widths.values()))
        return dict(zip(self.widths, np.split(rows, ends[:-1], axis=1), strict=True))
