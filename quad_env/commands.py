"""Velocity commands: draws, checks and the schedule of an episode."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quad_env.config import COMMAND_BOUND, CommandRanges

Array = NDArray[np.float64]


def draw_command(ranges: CommandRanges, stream: np.random.Generator) -> Array:
    """One command, (3,): always four numbers from the stream, so that a zero command shifts nothing."""
    coin, *unit = stream.random(4)
    low, high = np.transpose((ranges.forward, ranges.lateral, ranges.yaw_rate))
    return np.zeros(3) if coin < ranges.zero_fraction else low + (high - low) * np.asarray(unit)


def held_commands(command: ArrayLike, num_envs: int) -> Array:
    """Commands given by the caller, (num_envs, 3): one for all, or one each."""
    array = np.asarray(command, dtype=np.float64)
    if array.shape not in ((3,), (num_envs, 3)):
        raise ValueError(f"options['command'] has shape {array.shape}; wanted (3,) or ({num_envs}, 3)")
    if not (np.abs(array) <= COMMAND_BOUND).all():
        raise ValueError(f"options['command'] must be finite and within ±{COMMAND_BOUND:g}")
    return np.broadcast_to(array, (num_envs, 3)).copy()
