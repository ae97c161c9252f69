"""An ideal IMU at the trunk's centre, as far as it measures what the environment's infos do not have."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.config import GRAVITY
from quad_env.physics.state import rotation_matrix

WORLD_UP = np.array([0.0, 0.0, 1.0])


class TrunkImu:
    """Differentiates the velocity from step to step, so it needs all of them in order."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._velocity = np.zeros(3)

    def specific_force(self, readings: Mapping[str, Any], *, starts: bool) -> NDArray[np.float64]:
        """m/s² in the base frame, (3,), of one robot's infos; the robot rests where an episode starts."""
        rotation = np.array(rotation_matrix(tuple(readings["quaternion"])))
        cos, sin = rotation[:2, 0] / np.hypot(*rotation[:2, 0])
        forward, left = readings["heading_velocity"][:2]
        rising = float(np.squeeze(readings["vertical_velocity"]))
        velocity = np.array((forward * cos - left * sin, forward * sin + left * cos, rising))
        gained = np.zeros(3) if starts else velocity - self._velocity
        self._velocity = velocity
        return np.asarray((gained / self._dt + GRAVITY * WORLD_UP) @ rotation)
