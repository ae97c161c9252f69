"""Rows of a recording: what they are of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from live.recording.skeleton import Link
from quad_env.task.rewards import REWARD

Floats = NDArray[np.float64]


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
