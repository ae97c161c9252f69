"""How a robot comes to rest: in a controlled stop.

An episode ends in a controlled stop if in its last second the trunk leant less than 30° and never sank faster than
0.3 m/s, and at its end it was low and either at rest or on the ground. A fall that ends like that is no fall.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Floats
from evaluate.measures.episodes import Episodes

LOOK_BACK = 1.0
"""Time that counts as the end of an episode, s."""
LARGEST_TILT = np.deg2rad(30.0)
FASTEST_SINKING = 0.3
"""m/s."""
LOW = 0.3
"""Trunk centre above the ground, m; robots walk and stand higher, or move."""
AT_REST = 0.5
"""Joint speed below which a robot is at rest, rad/s."""
REST = 0.2
"""Time at rest with which an episode ends, s."""


@dataclass(frozen=True)
class Motion:
    """Motion of n robots, step by step, (steps, n); entries after a fall repeat the last."""

    height: Floats
    """Height of the trunk's centre above the ground, m."""
    upright: Floats
    """Cosine of the tilt."""
    vertical_velocity: Floats
    """m/s."""
    joint_speed: Floats
    """Largest of a robot's joints, rad/s."""


def motion_of(episodes: Episodes) -> Motion:
    """Motion of recorded episodes."""
    height = episodes.position[..., 2].astype(np.float64)
    return Motion(
        height=episodes.height.astype(np.float64),
        upright=np.cos(episodes.tilt.astype(np.float64)),
        vertical_velocity=np.diff(height, axis=0, prepend=height[:1]) / episodes.dt,
        joint_speed=np.abs(episodes.joint_velocity).max(axis=-1).astype(np.float64),
    )


def controlled_stops(motion: Motion, fall_step: NDArray[np.int64], dt: float) -> NDArray[np.bool_]:
    """Which episodes of control steps of `dt`, s, ended in a controlled stop, (n,); `fall_step` is the number of steps
    where there was no fall."""
    steps, count = motion.height.shape
    fell = fall_step < steps
    end = np.minimum(fall_step, steps - 1)
    time = np.arange(steps)[:, None]
    ending = (time <= end) & (time > end - round(LOOK_BACK / dt))
    quiet = (motion.upright > np.cos(LARGEST_TILT)) & (motion.vertical_velocity > -FASTEST_SINKING)
    gentle = (~ending | quiet).all(axis=0)
    resting = (~(ending & (time > end - round(REST / dt))) | (motion.joint_speed < AT_REST)).all(axis=0)
    low = motion.height[end, np.arange(count)] < LOW
    return np.asarray(gentle & low & (fell | resting))
