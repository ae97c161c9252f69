"""Where feet go: Raibert's footholds, steps that catch a push, the paths between.

In the level frame (see `policies.legs.level_frame`), legs along the first axis: arrays of shape (4, n), of robots (n,).
"""

import numpy as np

from policies.gait_cycle import Floats, smoothstep
from policies.legs.level_frame import Vector

Planar = tuple[Floats, Floats]

REACH_FORWARD = 0.22
"""Farthest that a foot is put ahead of or behind its neutral point, m."""
REACH_LATERAL = 0.12
"""Farthest to its side, m: the hip turns by half a radian."""


def passing(x: Floats, y: Floats, velocity: Vector) -> Planar:
    """Velocity of the ground under the trunk at feet (4, n), for a trunk's velocity (n,) each: -(v + ω × r)."""
    forward, lateral, yaw_rate = velocity
    return yaw_rate * y - forward, -yaw_rate * x - lateral


def raibert(
    neutral: Planar, velocity: Vector, stance_time: Floats | float, errors: Vector, gains: tuple[float, float, float]
) -> Planar:
    """Footholds half a stance ahead of the neutral points, and further by gain · error, the yaw's about the trunk."""
    x, y = neutral
    passed_x, passed_y = passing(x, y, velocity)
    half = 0.5 * stance_time
    forward, lateral, turn = gains
    error_x, error_y, error_yaw = errors
    return (
        x - half * passed_x + forward * error_x - turn * error_yaw * y,
        y - half * passed_y + lateral * error_y + turn * error_yaw * x,
    )


def captured(error: Planar, threshold: float, gain: float) -> Planar:
    """How much further out a step is put to catch a push: gain · what a velocity error is beyond the threshold."""
    x, y = error
    size = np.sqrt(x * x + y * y)
    share = gain * np.maximum(size - threshold, 0.0) / np.maximum(size, 1e-9)
    return share * x, share * y


def within_reach(x: Floats, y: Floats, neutral: Planar) -> Planar:
    """Feet drawn in to the ellipse about their neutral points that the legs reach."""
    away_x, away_y = x - neutral[0], y - neutral[1]
    size = np.sqrt((away_x / REACH_FORWARD) ** 2 + (away_y / REACH_LATERAL) ** 2)
    share = 1.0 / np.maximum(size, 1.0)
    return neutral[0] + share * away_x, neutral[1] + share * away_y


def swung(start: Floats, end: Floats, slope: Floats, progress: Floats) -> Floats:
    """Cubic from start to end that leaves and arrives with the same slope, per unit of progress: the ground's."""
    t = progress
    return start + smoothstep(t) * (end - start) + slope * (t * (1.0 - t) * (1.0 - 2.0 * t))
