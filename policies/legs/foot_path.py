"""Paths of feet: over one cycle relative to the body, as dimensionless shapes of a leg's progress, and to a foothold.

A stride carries the foot from +1/2 to -1/2 of its length at constant speed in stance, and back in swing. The swing
leaves the ground with the velocity that the stance ended with and lands with the velocity that the next one starts
with, so a foot that moves with the ground neither scuffs at lift-off nor brakes at touch-down.
"""

import numpy as np

from policies.gait_cycle import Floats, LegCycle, smoothstep
from quad_env.config import GRAVITY


def stride_displacement(cycle: LegCycle, duty: float) -> Floats:
    """Displacement along the stride, in stride lengths; +0.5 at touch-down, -0.5 at lift-off; shape of the cycle.

    In swing the cubic with u(0) = -1/2, u(1) = 1/2 and the stance's own slope at both ends: per unit of swing progress
    that slope is -r, with r = (swing time)/(stance time).
    """
    t = cycle.progress
    ratio = (1.0 - duty) / duty
    swing = smoothstep(t) - 0.5 - ratio * (t * (1.0 - t) * (1.0 - 2.0 * t))
    return np.where(cycle.swing, swing, 0.5 - t)


def swing_lift(cycle: LegCycle) -> Floats:
    """Height above the ground, in step heights: 0 in stance, 1 at mid-swing, level at both ends; shape of the cycle."""
    t = cycle.progress
    arc = 4.0 * t * (1.0 - t)
    return np.where(cycle.swing, arc * arc, 0.0)


def load_fraction(cycle: LegCycle) -> Floats:
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


def hip_bounce(cycle: LegCycle, swing_time: Floats, stance_time: Floats, bounce: Floats) -> Floats:
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


def cubic_swing(start: Floats, end: Floats, slope: Floats, progress: Floats) -> Floats:
    """Cubic from start to end that leaves and arrives with the same slope, per unit of progress: the ground's."""
    t = progress
    return start + smoothstep(t) * (end - start) + slope * (t * (1.0 - t) * (1.0 - 2.0 * t))
