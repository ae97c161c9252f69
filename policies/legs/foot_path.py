"""Foot paths: dimensionless shapes of a leg's progress through its cycle, and swing trajectories to a foothold.

A stride carries the foot from +1/2 to -1/2 of its length at constant speed in stance, and back in swing. The swing
leaves the ground with the velocity that the stance ended with and lands with the velocity that the next one starts
with, so a foot that moves with the ground neither scuffs at lift-off nor brakes at touch-down.
"""

import numpy as np

from policies.gait_cycle import Floats, LegCycle, smoothstep
from quad_env.config import GRAVITY


def stride_displacement(cycle: LegCycle, duty: float) -> Floats:
    """Compute the displacement of a foot along its stride, in stride lengths.

    In swing it is the cubic with u(0) = -1/2, u(1) = 1/2 and the slope of the stance at both ends. Per unit of swing
    progress this slope is -r, with r = (swing time)/(stance time).

    Args:
        cycle: Leg cycle.
        duty: Duty factor.

    Returns:
        +0.5 at touch-down, -0.5 at lift-off; shape of the cycle.
    """
    t = cycle.progress
    ratio = (1.0 - duty) / duty
    swing = smoothstep(t) - 0.5 - ratio * (t * (1.0 - t) * (1.0 - 2.0 * t))
    return np.where(cycle.swing, swing, 0.5 - t)


def swing_lift(cycle: LegCycle) -> Floats:
    """Compute the height of a foot in step heights: 0 in stance, 1 at mid-swing, level at both ends of the swing."""
    t = cycle.progress
    arc = 4.0 * t * (1.0 - t)
    return np.where(cycle.swing, arc * arc, 0.0)


def load_fraction(cycle: LegCycle) -> Floats:
    """Compute the share of its load that a foot carries: 0 in swing, 1 for most of the stance."""
    t = cycle.progress
    edge = (2.0 * t - 1.0) ** 2
    return np.where(cycle.swing, 0.0, 1.0 - edge * edge)


def cycloid(progress: Floats) -> tuple[Floats, Floats]:
    """Compute a cycloid: t - sin(2πt)/2π forward and sin²(πt) up, so that the foot lifts off and lands at rest.

    Args:
        progress: Progress t of the swing, 0 … 1.

    Returns:
        Share of the way over the ground, and share of the step height; shapes of `progress`.
    """
    turn = 2.0 * np.pi * progress
    return progress - np.sin(turn) / (2.0 * np.pi), 0.5 - 0.5 * np.cos(turn)


def hip_bounce(cycle: LegCycle, swing_time: Floats, stance_time: Floats, bounce: Floats) -> Floats:
    """Compute the height of a hip above its mean over a cycle: the stance throws it up, and the next one catches it.

    With `bounce` 1 the hip flies freely in swing, g·t·(T - t)/2, and its stance dips along a half-sine that takes up
    and gives back the same speed, gT/2. A smaller `bounce` scales both.

    Args:
        cycle: Leg cycle.
        swing_time: Duration T of a swing, s; broadcasts with the cycle.
        stance_time: Duration of a stance, s; broadcasts with the cycle.
        bounce: Scale, 0 … 1; broadcasts with the cycle.

    Returns:
        Height, m.
    """
    t = cycle.progress
    fall = 0.5 * GRAVITY * bounce * swing_time
    height: Floats = np.where(
        cycle.swing, fall * swing_time * t * (1.0 - t), -fall * stance_time / np.pi * np.sin(np.pi * t)
    )
    return height


def cubic_swing(start: Floats, end: Floats, slope: Floats, progress: Floats) -> Floats:
    """Interpolate from start to end by a cubic with the same slope at both ends.

    Args:
        start: Value at progress 0.
        end: Value at progress 1.
        slope: Slope at both ends per unit of progress; for a foot, the velocity of the ground.
        progress: Progress, 0 … 1.

    Returns:
        Value at the progress.
    """
    t = progress
    return start + smoothstep(t) * (end - start) + slope * (t * (1.0 - t) * (1.0 - 2.0 * t))
