"""Velocity commands."""

import numpy as np
from numpy.typing import NDArray

from quad_env.config import CommandRanges

Array = NDArray[np.float64]


def draw_command(ranges: CommandRanges, stream: np.random.Generator) -> Array:
    """One command, (3,): always four numbers from the stream, so that a zero command shifts nothing."""
    coin, *unit = stream.random(4)
    low, high = np.transpose((ranges.forward, ranges.lateral, ranges.yaw_rate))
    return np.zeros(3) if coin < ranges.zero_fraction else low + (high - low) * np.asarray(unit)
