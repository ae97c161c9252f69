"""Functions for rotations: quaternions from roll, pitch and yaw, and back; cross products and their matrices."""

import numpy as np

from quad_env.columns import Array

_NEXT = np.array([1, 2, 0])
_LAST = np.array([2, 0, 1])
_SKEW = np.cross(np.eye(3), -np.eye(3)[:, None]).transpose(1, 0, 2).reshape(3, 9)
"""Flattened cross-product matrices of the three unit vectors, (3, 9); `skew` combines them linearly."""


def quaternion(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Convert roll, pitch and yaw angles to quaternions; the intrinsic rotations are in the order yaw, pitch, roll.

    Args:
        roll: Roll angles, (n,), rad.
        pitch: Pitch angles, (n,), rad.
        yaw: Yaw angles, (n,), rad.

    Returns:
        Quaternions (w, x, y, z), (n, 4).
    """
    cr, sr = np.cos(roll / 2), np.sin(roll / 2)
    cp, sp = np.cos(pitch / 2), np.sin(pitch / 2)
    cy, sy = np.cos(yaw / 2), np.sin(yaw / 2)
    w = cr * cp * cy + sr * sp * sy
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    return np.stack((w, x, y, z), axis=1)


def roll_pitch_yaw(orientation: Array) -> Array:
    """Convert the quaternion `orientation` (w, x, y, z), (4,), to roll, pitch and yaw, (3,), rad; see `quaternion`."""
    w, x, y, z = orientation
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.array((roll, pitch, yaw))


def cross(a: Array, b: Array) -> Array:
    """Return the cross products `a` × `b`, (..., 3).

    The results have the same bits as `np.cross`, which takes seven times as long for a few vectors.

    Args:
        a: Vectors, (..., 3).
        b: Vectors, (..., 3).

    Returns:
        Cross product of each pair of vectors, (..., 3).
    """
    product: Array = a.take(_NEXT, -1) * b.take(_LAST, -1) - a.take(_LAST, -1) * b.take(_NEXT, -1)
    return product


def skew(vectors: Array) -> Array:
    """Return the cross-product matrices S(v), (..., 3, 3), with S(v) w = v × w, of `vectors` v, (..., 3)."""
    matrices: Array = np.matmul(vectors, _SKEW).reshape(*vectors.shape, 3)
    return matrices
