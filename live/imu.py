"""An ideal IMU at the trunk's centre: orientation, angular velocity, and the specific force of each control step."""

import numpy as np
from numpy.typing import NDArray

from quad_env.config import GRAVITY
from quad_env.physics.state import rotation_matrix

Floats = NDArray[np.float64]
READINGS = ("quaternion", "angular_velocity", "heading_velocity", "vertical_velocity")
"""Infos of the environment that it measures."""
UP = np.array([0.0, 0.0, 1.0])


class Imu:
    """Differentiates the velocity from row to row, so it needs all rows in order."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._velocity = np.zeros((1, 3))

    def measure(self, readings: dict[str, Floats], starts: NDArray[np.bool_]) -> Floats:
        """w x y z, rad/s and m/s² in the base frame, (n, 10), of n rows' columns; it rests at starts of episodes."""
        rotation = np.array(rotation_matrix(tuple(readings["quaternion"].T)))  # (3, 3, n)
        cos, sin = (part / np.hypot(rotation[0, 0], rotation[1, 0]) for part in (rotation[0, 0], rotation[1, 0]))
        forward, left = readings["heading_velocity"].T[:2]
        rising = readings["vertical_velocity"][:, 0]
        velocity = np.column_stack((forward * cos - left * sin, forward * sin + left * cos, rising))
        gained = velocity - np.concatenate((self._velocity, velocity[:-1]))
        gained[starts] = 0.0
        self._velocity = velocity[-1:]
        force = np.einsum("jin,nj->ni", rotation, gained / self._dt + GRAVITY * UP)
        return np.column_stack((readings["quaternion"], readings["angular_velocity"], force))
