"""Controlled stops: episodes in which the robot lowers itself to the ground and comes to rest.

An episode ends in a controlled stop if three conditions hold. In its last second, the trunk leans less than 30° and
sinks slower than 0.3 m/s. At its end, the trunk's centre is below 0.3 m. The episode ends because a condition for a
fall holds (contact of the trunk, tilt or height), or it ends with the joints at rest. An episode that ends in a
controlled stop does not count as a fall.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.episodes import Episodes

END_TIME = 1.0
"""Time before the end of an episode in which tilt and sink speed of the trunk are checked, s."""
MAX_TILT = np.deg2rad(30.0)
"""Maximum tilt of the trunk from the vertical in a controlled stop, rad."""
MAX_SINK_SPEED = 0.3
"""Maximum downward speed of the trunk in a controlled stop, m/s."""
MAX_REST_HEIGHT = 0.3
"""Maximum height of the trunk's centre above the ground at the end of a controlled stop, m.

The limit excludes robots that stand still, because their trunk is higher.
"""
MAX_REST_JOINT_SPEED = 0.5
"""Speed below which a joint is at rest, in the definition of a controlled stop, rad/s."""
MIN_REST_TIME = 0.2
"""Time before the end of an episode during which all joints must be at rest for a controlled stop, s."""


def controlled_stops(episodes: Episodes) -> NDArray[np.bool_]:
    """Return True for each of n `episodes` that ended in a controlled stop (robot lies down gently), (n,)."""
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
    """Return True for control steps in which the trunk leans little and sinks slowly, (steps, n).

    The trunk leans little if its tilt is below MAX_TILT, and sinks slowly if its downward speed is below
    MAX_SINK_SPEED.
    """
    height = episodes.position[..., 2].astype(np.float64)
    sink_speed = -np.diff(height, axis=0, prepend=height[:1]) / episodes.dt
    is_upright = np.cos(episodes.tilt.astype(np.float64)) > np.cos(MAX_TILT)
    return np.asarray(is_upright & (sink_speed < MAX_SINK_SPEED))
