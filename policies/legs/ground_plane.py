"""The ground as the feet have met it: where each foot last stood, and the plane through these footprints.

Everything is in the level frame (see `policies.legs.level_frame`), legs along the first axis: arrays of shape (4, n).
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.legs.level_frame import Vector
from quad_env.columns import ordered_sum

MAX_SLOPE = 1.2
"""Largest slope that a fit gives, m/m."""
_NARROW = 1e-6
"""Added to the spread of the footprints, m²: what would make a plane of footprints on one line."""

Plane = tuple[Floats, Floats, Floats]
"""Height at the trunk's x, y (relative to the trunk's centre, m) and rise per metre forward and to the left; (n,)."""


def advect_footprints(prints: Floats, velocity: Vector | Floats, yaw_rate: Floats, period: float) -> Floats:
    """Footprints, (3, 4, n), m, one period of `period` s later: they pass under a trunk that moves and turns."""
    x, y, _ = prints
    forward, lateral, passed = velocity[0], velocity[1], np.empty_like(prints)
    passed[0], passed[1], passed[2] = forward - yaw_rate * y, lateral + yaw_rate * x, velocity[2]
    return prints - period * passed


def fit_plane(prints: Floats) -> Plane:
    """Least-squares plane through the footprints."""
    legs = prints.swapaxes(0, 1)
    mean_x, mean_y, mean_z = mean = 0.25 * ordered_sum(legs)
    apart = legs - mean
    xx, yy, xy, xz, yz = ordered_sum(apart[:, [0, 1, 0, 0, 1]] * apart[:, [0, 1, 1, 2, 2]])
    xx, yy = xx + _NARROW, yy + _NARROW
    determinant = np.maximum(xx * yy - xy * xy, _NARROW * _NARROW)
    forward = ((xz * yy - yz * xy) / determinant).clip(-MAX_SLOPE, MAX_SLOPE)
    lateral = ((yz * xx - xz * xy) / determinant).clip(-MAX_SLOPE, MAX_SLOPE)
    return mean_z - forward * mean_x - lateral * mean_y, forward, lateral


def plane_height(plane: Plane, x: Floats, y: Floats) -> Floats:
    """Height of the plane there, relative to the trunk's centre, m; shapes that broadcast with (n,)."""
    height, forward, lateral = plane
    there: Floats = height + forward * x + lateral * y
    return there


def height_above_plane(plane: Plane, prints: Floats) -> Floats:
    """Height of each footprint above the plane, m, (4, n)."""
    height: Floats = prints[2] - plane_height(plane, prints[0], prints[1])
    return height
