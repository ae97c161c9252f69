"""How a robot comes to rest: in a controlled stop.

An episode ends in a controlled stop if in its last second the trunk leant less than 30° and never sank faster than
0.3 m/s, and at its end it was low and either at rest or on the ground. A fall that ends like that is no fall.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.episodes import Episodes

LOOK_BACK = 1.0
"""Time that counts as the end of an episode, s."""
LARGEST_TILT = np.deg2rad(30.0)
FASTEST_SINKING = 0.3
"""m/s."""
MAX_REST_HEIGHT = 0.3
"""Trunk centre above the ground, m; robots walk and stand higher, or move."""
AT_REST = 0.5
"""Joint speed below which a robot is at rest, rad/s."""
REST = 0.2
"""Time at rest with which an episode ends, s."""


def controlled_stops(episodes: Episodes) -> NDArray[np.bool_]:
    """Which episodes ended in a controlled stop, (n,)."""
    position, steps, dt = episodes.position[..., 2].astype(np.float64), episodes.steps, episodes.dt
    sinking = -np.diff(position, axis=0, prepend=position[:1]) / dt
    end, time = np.minimum(episodes.fall_step, steps - 1), np.arange(steps)[:, None]
    ending = (time <= end) & (time > end - round(LOOK_BACK / dt))
    quiet = (np.cos(episodes.tilt.astype(np.float64)) > np.cos(LARGEST_TILT)) & (sinking < FASTEST_SINKING)
    still = np.abs(episodes.joint_velocity).max(axis=-1) < AT_REST
    gentle = (~ending | quiet).all(axis=0)
    resting = (~(ending & (time > end - round(REST / dt))) | still).all(axis=0)
    low = episodes.height[end, np.arange(episodes.count)].astype(np.float64) < MAX_REST_HEIGHT
    return np.asarray(gentle & low & ((episodes.fall_step < steps) | resting))
