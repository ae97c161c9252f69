"""Ground plane through the footprints, the places where the feet last stood.

All quantities are in the level frame (see `policies.legs.level_frame`). The legs are on the first axis of a coordinate,
which is an array (4, n).
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.legs.level_frame import Vector
from quad_env.columns import ordered_sum

MAX_SLOPE = 1.2
"""Largest slope of a fitted plane along each axis, m/m."""
_SPREAD_REGULARISATION = 1e-6
"""Added to the spread of the footprints, so that footprints on a line also define a plane, m²."""

Plane = tuple[Floats, Floats, Floats]
"""Height of the plane below the trunk, relative to the trunk centre, (n,), m, and rise per metre forward and to the
left, (n,) each."""


def advect_footprints(prints: Floats, velocity: Vector | Floats, yaw_rate: Floats, period: float) -> Floats:
    """Return the footprints relative to the trunk after a time step in which the trunk moves and turns.

    Args:
        prints: Footprints, (3, 4, n), m.
        velocity: Velocity of the trunk, (3, n), m/s.
        yaw_rate: Yaw rate of the trunk, (n,), rad/s.
        period: Time step, s.

    Returns:
        Footprints after the time step, (3, 4, n), m.
    """
    x, y, _ = prints
    passing = np.empty_like(prints)
    passing[0] = velocity[0] - yaw_rate * y
    passing[1] = velocity[1] + yaw_rate * x
    passing[2] = velocity[2]
    return prints - period * passing


def fit_plane(prints: Floats) -> Plane:
    """Fit the least-squares plane through the footprints, (3, 4, n), m."""
    legs = prints.swapaxes(0, 1)
    mean = 0.25 * ordered_sum(legs)
    centred = legs - mean
    xx, yy, xy, xz, yz = ordered_sum(centred[:, [0, 1, 0, 0, 1]] * centred[:, [0, 1, 1, 2, 2]])
    xx = xx + _SPREAD_REGULARISATION
    yy = yy + _SPREAD_REGULARISATION
    determinant = np.maximum(xx * yy - xy * xy, _SPREAD_REGULARISATION * _SPREAD_REGULARISATION)
    forward = ((xz * yy - yz * xy) / determinant).clip(-MAX_SLOPE, MAX_SLOPE)
    lateral = ((yz * xx - xz * xy) / determinant).clip(-MAX_SLOPE, MAX_SLOPE)
    return mean[2] - forward * mean[0] - lateral * mean[1], forward, lateral


def plane_height(plane: Plane, x: Floats, y: Floats) -> Floats:
    """Compute the height of the plane at some points, relative to the trunk centre.

    Args:
        plane: Plane.
        x: Forward coordinate of the points, broadcasts with (n,), m.
        y: Lateral coordinate of the points, broadcasts with (n,), m.

    Returns:
        Height, m.
    """
    height, forward, lateral = plane
    height_at_point: Floats = height + forward * x + lateral * y
    return height_at_point


def height_above_plane(plane: Plane, prints: Floats) -> Floats:
    """Compute the height above the `plane`, (4, n), m, of the footprints `prints`, (3, 4, n), m."""
    height: Floats = prints[2] - plane_height(plane, prints[0], prints[1])
    return height
