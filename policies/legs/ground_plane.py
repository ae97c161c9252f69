"""The ground as the feet have met it: where each foot last stood, and the plane through these footprints.

Everything is in the level frame (see `policies.legs.level_frame`), legs along the first axis: arrays of shape (4, n).
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.legs.level_frame import Vector
from quad_env.columns import total

STEEPEST = 1.2
"""Largest slope that a fit gives, m/m."""
_NARROW = 1e-6
"""Added to the spread of the footprints, m²: what would make a plane of footprints on one line."""

Plane = tuple[Floats, Floats, Floats]
"""Height at the trunk's x, y (relative to the trunk's centre, m) and rise per metre forward and to the left; (n,)."""


def carried(prints: Floats, velocity: Vector | Floats, yaw_rate: Floats, period: float) -> Floats:
    """Footprints, (3, 4, n), m, one period of `period` s later: they pass under a trunk that moves and turns."""
    x, y, _ = prints
    forward, lateral, vertical = velocity
    passed = np.broadcast_arrays(forward - yaw_rate * y, lateral + yaw_rate * x, vertical)
    return prints - period * np.stack(passed)


def fitted(prints: Floats) -> Plane:
    """Least-squares plane through the footprints."""
    x, y, z = prints
    mean_x, mean_y, mean_z = (0.25 * total(values) for values in prints)
    x, y, z = x - mean_x, y - mean_y, z - mean_z
    xx, yy, xy = total(x * x) + _NARROW, total(y * y) + _NARROW, total(x * y)
    xz, yz = total(x * z), total(y * z)
    determinant = np.maximum(xx * yy - xy * xy, _NARROW * _NARROW)
    forward = np.clip((xz * yy - yz * xy) / determinant, -STEEPEST, STEEPEST)
    lateral = np.clip((yz * xx - xz * xy) / determinant, -STEEPEST, STEEPEST)
    return mean_z - forward * mean_x - lateral * mean_y, forward, lateral


def at(plane: Plane, x: Floats, y: Floats) -> Floats:
    """Height of the plane there, relative to the trunk's centre, m; shapes that broadcast with (n,)."""
    height, forward, lateral = plane
    there: Floats = height + forward * x + lateral * y
    return there


def above(plane: Plane, prints: Floats) -> Floats:
    """Height of each footprint above the plane, m, (4, n)."""
    height: Floats = prints[2] - at(plane, prints[0], prints[1])
    return height
