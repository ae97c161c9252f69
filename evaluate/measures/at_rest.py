"""Controlled stops: episodes in which the robot comes to rest under control.

An episode ends in a controlled stop if three conditions hold. The trunk leans less than 30° and sinks slower than
0.3 m/s in the last second. The trunk is low at the end. The episode ends by a fall, or with the joints at rest.
A fall that ends in a controlled stop does not count as a fall.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.episodes import Episodes

END_TIME = 1.0
"""Time before the end of an episode in which tilt and sink speed are checked, s."""
MAX_TILT = np.deg2rad(30.0)
"""Maximum tilt of the trunk in a controlled stop, rad."""
MAX_SINK_SPEED = 0.3
"""Maximum downward speed of the trunk in a controlled stop, m/s."""
MAX_REST_HEIGHT = 0.3
"""Maximum height of the trunk's centre above the ground at the end of a controlled stop, m.

A robot that stands or walks is higher, or its joints move.
"""
MAX_REST_JOINT_SPEED = 0.5
"""Joint speed below which a robot is at rest, rad/s."""
MIN_REST_TIME = 0.2
"""Time at the end of an episode in which the joints must be at rest, s."""


def controlled_stops(episodes: Episodes) -> NDArray[np.bool_]:
    """Return the mask of the episodes that ended in a controlled stop, (n,)."""
    steps = episodes.steps
    dt = episodes.dt
    end = np.minimum(episodes.fall_step, steps - 1)
    step = np.arange(steps)[:, None]
    in_end = (step <= end) & (step > end - round(END_TIME / dt))
    in_rest = in_end & (step > end - round(MIN_REST_TIME / dt))
    is_still = np.abs(episodes.joint_velocity).max(axis=-1) < MAX_REST_JOINT_SPEED
    ended_gently = (~in_end | _is_gentle(episodes)).all(axis=0)
    ended_still = (~in_rest | is_still).all(axis=0)
    ended_low = episodes.height[end, np.arange(episodes.count)].astype(np.float64) < MAX_REST_HEIGHT
    return np.asarray(ended_gently & ended_low & ((episodes.fall_step < steps) | ended_still))


def _is_gentle(episodes: Episodes) -> NDArray[np.bool_]:
    """Return the mask of the steps with tilt and sink speed below their limits, (steps, n)."""
    height = episodes.position[..., 2].astype(np.float64)
    sink_speed = -np.diff(height, axis=0, prepend=height[:1]) / episodes.dt
    is_upright = np.cos(episodes.tilt.astype(np.float64)) > np.cos(MAX_TILT)
    return np.asarray(is_upright & (sink_speed < MAX_SINK_SPEED))
