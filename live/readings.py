"""Readings that the messages of ROS have and the environment's infos do not."""

import numpy as np

from policies.base import Floats
from quad_env.config import GRAVITY
from quad_env.physics.state import rotation_matrix


class Accelerometer:
    """An ideal one at the trunk's centre, read at the end of every control step of one robot."""

    def __init__(self, dt: float) -> None:
        """`dt`: control period, s."""
        self._dt = dt
        self.restart()

    def restart(self) -> None:
        """Forget the velocity before, as at the start of an episode."""
        self._velocity: Floats | None = None

    def read(self, quaternion: Floats, heading_velocity: Floats, vertical_velocity: float) -> Floats:
        """Specific force, mean of the step, base frame, m/s², (3,); of the infos of those names."""
        rotation: Floats = np.array(rotation_matrix(tuple(quaternion)))
        yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
        forward, left = heading_velocity[:2]
        velocity = np.array(
            [
                forward * np.cos(yaw) - left * np.sin(yaw),
                forward * np.sin(yaw) + left * np.cos(yaw),
                vertical_velocity,
            ]
        )
        before = velocity if self._velocity is None else self._velocity
        self._velocity = velocity
        force: Floats = rotation.T @ ((velocity - before) / self._dt + np.array([0.0, 0.0, GRAVITY]))
        return force
