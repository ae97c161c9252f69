"""Estimate of the ground as a plane through the footprints, the last contact position of each foot.

All quantities are in the level frame: origin at the trunk centre, x along the heading, z up. A coordinate of the
footprints of n robots is an array (4, n), with one row for each leg.
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.legs.level_frame import Vector
from quad_env.columns import ordered_sum

MAX_SLOPE = 1.2
"""Largest slope of the fitted ground plane along the forward and the lateral axis, m/m."""
_SPREAD_REGULARISATION = 1e-6
"""Regularisation of the least-squares fit of the ground plane, m².

It is added to the sums of the squared horizontal coordinates of the footprints.

The regularisation is needed because footprints on a straight line would otherwise define no plane."""

Plane = tuple[Floats, Floats, Floats]
"""Type of the ground planes under n robots: a tuple of height, forward slope and lateral slope.

The height, (n,), m, is the height of the plane at the point below the trunk centre, relative to the trunk centre. The
slopes, along the heading and to the left, are the rise per metre, (n,)."""


def advect_footprints(prints: Floats, velocity: Vector | Floats, yaw_rate: Floats, period: float) -> Floats:
    """Compute the positions of the footprints relative to the trunk after a time step of trunk motion.

    A footprint is the last contact position of a foot.

    Args:
        prints: Footprints before the time step, level frame (x along the heading, z up), (3, 4, n), m.
        velocity: Velocity of the trunk, level frame (x along the heading, z up), (3, n), m/s.
        yaw_rate: Yaw rate of the trunk, (n,), rad/s.
        period: Time step, s.

    Returns:
        Footprints after the time step, level frame (x along the heading, z up), (3, 4, n), m.
    """
    x, y, _ = prints
    passing = np.empty_like(prints)
    passing[0] = velocity[0] - yaw_rate * y
    passing[1] = velocity[1] + yaw_rate * x
    passing[2] = velocity[2]
    return prints - period * passing


def fit_plane(prints: Floats) -> Plane:
    """Fit the ground plane of n robots to their footprints by least squares.

    The footprints `prints`, (3, 4, n), m, are the last contact positions of the four feet in the level frame (x along
    the heading, z up). The slopes of the plane are limited to ±MAX_SLOPE.
    """
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
    """Compute the height of the ground plane at given points, relative to the trunk centre.

    Args:
        plane: Ground plane of n robots, level frame (x along the heading, z up).
        x: Coordinate of the points along the heading, relative to the trunk centre, broadcasts with (n,), m.
        y: Coordinate of the points to the left, relative to the trunk centre, broadcasts with (n,), m.

    Returns:
        Height of the plane at each point, m.
    """
    height, forward, lateral = plane
    height_at_point: Floats = height + forward * x + lateral * y
    return height_at_point


def height_above_plane(plane: Plane, prints: Floats) -> Floats:
    """Compute the vertical distance of each footprint from the ground plane, positive above the plane.

    Args:
        plane: Ground plane of n robots.
        prints: Last contact positions of the four feet, level frame (x along the heading, z up), (3, 4, n), m.

    Returns:
        Height of each footprint above the plane, (4, n), m.
    """
    height: Floats = prints[2] - plane_height(plane, prints[0], prints[1])
    return height
