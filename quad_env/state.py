"""Named readings of n robots, computed from the current positions and velocities, never from a substep earlier."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class QuadState:
    """Readings that observations, rewards, terminations and infos may look at; every array has n rows."""

    position: Array
    """Trunk centre in the world frame, (n, 3), m."""
    height: Array
    """Trunk centre above the terrain below it, (n,), m."""
    rotation: Array
    """Rotation matrix from the base frame to the world frame, (n, 3, 3)."""
    linear_velocity: Array
    """Of the trunk's centre, in the base frame, (n, 3), m/s."""
    angular_velocity: Array
    """Of the trunk, in the base frame, (n, 3), rad/s."""
    heading_velocity: Array
    """Forward and lateral velocity of the trunk's centre in the heading frame, m/s, and yaw rate about the world's
    vertical, rad/s; (n, 3)."""
    vertical_velocity: Array
    """World frame, (n,), m/s."""
    joint_position: Array
    """(n, 12), rad."""
    joint_velocity: Array
    """(n, 12), rad/s."""
    joint_torque: Array
    """Servo torque during the last physics substep, (n, 12), N·m."""
    trunk_contact: NDArray[np.bool_]
    """Whether the trunk touched the ground in the last physics substep, (n,)."""
    command: Array
    """In force during the step: forward and lateral velocity, m/s, and yaw rate, rad/s; (n, 3)."""
    action: Array
    """Joint targets of the step, clipped, (n, 12), rad."""
    previous_action: Array
    """Joint targets of the step before, (n, 12), rad."""

    @property
    def projected_gravity(self) -> Array:
        """Unit vector of gravity in the base frame, (n, 3)."""
        return -self.rotation[:, 2, :]


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrices of quaternions (w, x, y, z), normalised first; (n, 4) -> (n, 3, 3)."""
    square = quaternion * quaternion
    norm = np.sqrt(square[:, 0] + square[:, 1] + square[:, 2] + square[:, 3])
    w, x, y, z = (quaternion / norm[:, None]).T
    matrix = np.empty((len(quaternion), 3, 3))
    matrix[:, 0, 0] = 1 - 2 * (y * y + z * z)
    matrix[:, 0, 1] = 2 * (x * y - w * z)
    matrix[:, 0, 2] = 2 * (x * z + w * y)
    matrix[:, 1, 0] = 2 * (x * y + w * z)
    matrix[:, 1, 1] = 1 - 2 * (x * x + z * z)
    matrix[:, 1, 2] = 2 * (y * z - w * x)
    matrix[:, 2, 0] = 2 * (x * z - w * y)
    matrix[:, 2, 1] = 2 * (y * z + w * x)
    matrix[:, 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def to_body(rotation: Array, vector_world: Array) -> Array:
    """World vectors in the base frame: Rᵀ v, written out so that a row's bits do not depend on the batch; (n, 3)."""
    x, y, z = vector_world[:, 0, None], vector_world[:, 1, None], vector_world[:, 2, None]
    return rotation[:, 0, :] * x + rotation[:, 1, :] * y + rotation[:, 2, :] * z


def heading_velocity(rotation: Array, linear_world: Array, angular_body: Array) -> Array:
    """Planar velocity in the heading frame and yaw rate about the world's vertical, (n, 3).

    The heading frame is the world frame turned about the vertical onto the base frame's x axis. A trunk that points
    straight up or down has no heading; the world's x axis stands in for it.
    """
    forward_x, forward_y = rotation[:, 0, 0], rotation[:, 1, 0]
    length = np.sqrt(forward_x * forward_x + forward_y * forward_y)
    upright = length > 1e-6
    safe = np.where(upright, length, 1.0)
    cos, sin = np.where(upright, forward_x / safe, 1.0), np.where(upright, forward_y / safe, 0.0)
    out = np.empty((len(rotation), 3))
    out[:, 0] = cos * linear_world[:, 0] + sin * linear_world[:, 1]
    out[:, 1] = cos * linear_world[:, 1] - sin * linear_world[:, 0]
    up = rotation[:, 2, :]
    out[:, 2] = up[:, 0] * angular_body[:, 0] + up[:, 1] * angular_body[:, 1] + up[:, 2] * angular_body[:, 2]
    return out
