"""Ideal accelerometer at the centre of the trunk, which computes the specific force: acceleration minus gravity.

The recordings and the ROS interface need the specific force, but the infos of the environment do not contain it.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.config import GRAVITY
from quad_env.physics.state import rotation_matrix

WORLD_UP = np.array([0.0, 0.0, 1.0])


class TrunkImu:
    """Ideal accelerometer of one robot.

    The accelerometer differentiates the velocity. Therefore `specific_force` must be called once after each control
    step, in the order of the steps.

    Args:
        dt: Control period, s.
    """

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._velocity = np.zeros(3)

    def specific_force(self, infos: Mapping[str, Any], *, is_first: bool) -> NDArray[np.float64]:
        """Compute the mean specific force at the trunk centre over the last control step.

        Args:
            infos: Infos of the environment for this robot after the control step.
            is_first: True at the start of an episode, where the acceleration is assumed to be zero.

        Returns:
            Specific force (acceleration minus gravity), base frame, (3,), m/s².
        """
        # The matrix rotates vectors from the base frame to the world frame.
        rotation = np.array(rotation_matrix(tuple(infos["quaternion"])))
        cos, sin = rotation[:2, 0] / np.hypot(*rotation[:2, 0])
        forward, left = infos["heading_velocity"][:2]
        up = float(np.squeeze(infos["vertical_velocity"]))
        velocity_world = np.array((forward * cos - left * sin, forward * sin + left * cos, up))
        velocity_change = np.zeros(3) if is_first else velocity_world - self._velocity
        self._velocity = velocity_world
        return np.asarray((velocity_change / self._dt + GRAVITY * WORLD_UP) @ rotation)
