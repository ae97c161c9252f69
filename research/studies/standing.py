"""Whether a robot stands on its legs."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env import OBSERVATION

STANDING_TILT = np.deg2rad(10.0)
"""Largest tilt of a robot that stands."""
STANDING_HEIGHT = 0.45
"""Least height of the trunk's centre above the terrain, m."""
STANDING_SPEED = 0.3
"""Speed of the trunk along, m/s, and about, rad/s, each of its axes."""


def standing(observation: NDArray[np.float32], infos: dict[str, Any]) -> NDArray[np.bool_]:
    """Which robots stand, (n,), after getting up: upright, high and still.

    One that has diverged is parked in its home pose and does not.

    `observation`, (n, k), is the true one; `infos` hold the environment's readings.
    """
    upright = -observation[:, OBSERVATION["projected_gravity"]][:, 2] > np.cos(STANDING_TILT)
    motion = np.abs(observation[:, OBSERVATION["angular_velocity"].start : OBSERVATION["linear_velocity"].stop])
    still = motion.max(axis=1) < STANDING_SPEED
    return np.asarray(upright & still & (infos["height"] > STANDING_HEIGHT) & ~infos["diverged"])
