"""Standing: the one rule by which a robot counts as standing on its legs, after a jump as after getting up."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools
from quad_env import OBSERVATION

LARGEST_TILT = np.deg2rad(10.0)
LOWEST = 0.45
"""Trunk's centre above the terrain, m."""
FASTEST = 0.3
"""Speed of the trunk along, m/s, and about, rad/s, each of its axes."""


def standing(observation: NDArray[np.float32], infos: dict[str, Any]) -> Bools:
    """Which robots stand, (n,): upright, high and still; one that has diverged is parked in its home pose and does not.

    `observation`, (n, k), is the true one; `infos` hold the environment's readings.
    """
    upright = -observation[:, OBSERVATION["projected_gravity"]][:, 2] > np.cos(LARGEST_TILT)
    motion = np.abs(observation[:, OBSERVATION["angular_velocity"].start : OBSERVATION["linear_velocity"].stop])
    still = motion.max(axis=1) < FASTEST
    return np.asarray(upright & still & (infos["height"] > LOWEST) & ~infos["diverged"])
