"""Paths of feet: over one cycle relative to the body, as dimensionless shapes of a leg's progress, and to footholds.

A stride carries the foot from +1/2 to -1/2 of its length at constant speed in stance, and back in swing. The swing
leaves the ground with the velocity that the stance ended with and lands with the velocity that the next one starts
with, so a foot that moves with the ground neither scuffs at lift-off nor brakes at touch-down.

Footholds are in the level frame (see `policies.legs.level_frame`), legs first: arrays (4, n), of robots (n,).
"""

import numpy as np

from policies.gait_cycle import Floats, LegCycle, smoothstep
from policies.legs.level_frame import Vector
from quad_env.config import GRAVITY


def stride(cycle: LegCycle, duty: float) -> Floats:
    """Displacement along the stride, in stride lengths; +0.5 at touch-down, -0.5 at lift-off; shape of the cycle.

    In swing the cubic with u(0) = -1/2, u(1) = 1/2 and the stance's own slope at both ends: per unit of swing progress
    that slope is -r, with r = (swing time)/(stance time).
    """
    t = cycle.progress
    ratio = (1.0 - duty) / duty
    swing = smoothstep(t) - 0.5 - ratio * (t * (1.0 - t) * (1.0 - 2.0 * t))
    return np.where(cycle.swing, swing, 0.5 - t)


def lift(cycle: LegCycle) -> Floats:
    """Height above the ground, in step heights: 0 in stance, 1 at mid-swing, level at both ends; shape of the cycle."""
    t = cycle.progress
    arc = 4.0 * t * (1.0 - t)
    return np.where(cycle.swing, arc * arc, 0.0)


def load(cycle: LegCycle) -> Floats:
    """Share of its load that a foot carries: 0 in swing, 1 for most of the stance; shape of the cycle."""
    t = cycle.progress
    edge = (2.0 * t - 1.0) ** 2
    return np.where(cycle.swing, 0.0, 1.0 - edge * edge)


def cycloid(progress: Floats) -> tuple[Floats, Floats]:
    """Share of the way over the ground and of the step height at a swing progress from 0 to 1; shapes of `progress`.

    t - sin(2πt)/2π forward and sin²(πt) up: the foot leaves the ground and lands on it at rest.
    """
    turn = 2.0 * np.pi * progress
    return progress - np.sin(turn) / (2.0 * np.pi), 0.5 - 0.5 * np.cos(turn)


def hip_height(cycle: LegCycle, swing_time: Floats, stance_time: Floats, bounce: Floats) -> Floats:
    """Height of a hip about its mean course over a cycle, m: thrown up by the stance and caught by the next one.

    With `bounce` 1 the hip flies freely in swing, g·t·(T - t)/2, and its stance dips along a half-sine that takes up
    and gives back the same speed, gT/2; a smaller `bounce` scales both. Times in s, shapes to broadcast with the
    cycle's.
    """
    t = cycle.progress
    fall = 0.5 * GRAVITY * bounce * swing_time
    height: Floats = np.where(
        cycle.swing, fall * swing_time * t * (1.0 - t), -fall * stance_time / np.pi * np.sin(np.pi * t)
    )
    return height


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
