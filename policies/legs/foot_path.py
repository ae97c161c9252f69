"""Foot paths: dimensionless functions of the leg cycle, and swing trajectories to a foothold.

In stance a foot moves from +1/2 to -1/2 of the stride length at constant speed, and in swing back again. At lift-off
and at touch-down the swing has the velocity of the stance. The foot therefore moves with the ground at both ends, and
neither scuffs at lift-off nor brakes at touch-down.
"""

import numpy as np

from policies.gait_cycle import Floats, LegCycle, smoothstep
from quad_env.config import GRAVITY


def stride_displacement(cycle: LegCycle, duty: float) -> Floats:
    """Compute the displacement of a foot along its stride, in stride lengths.

    In swing the displacement u is the cubic with u(0) = -1/2, u(1) = 1/2 and the slope of the stance at both ends. Per
    unit of swing progress this slope is -r, with r = (swing time)/(stance time).

    Args:
        cycle: Leg cycle.
        duty: Duty factor.

    Returns:
        Displacement, +0.5 at touch-down and -0.5 at lift-off, in the shape of `cycle.progress`.
    """
    t = cycle.progress
    ratio = (1.0 - duty) / duty
    swing = smoothstep(t) - 0.5 - ratio * (t * (1.0 - t) * (1.0 - 2.0 * t))
    return np.where(cycle.swing, swing, 0.5 - t)


def swing_lift(cycle: LegCycle) -> Floats:
    """Compute the height of a foot as a fraction of the step height: 0 in stance, 1 at mid-swing.

    The height has slope 0 at both ends of the swing.
    """
    t = cycle.progress
    arc = 4.0 * t * (1.0 - t)
    return np.where(cycle.swing, arc * arc, 0.0)


def load_fraction(cycle: LegCycle) -> Floats:
    """Compute the load of a foot relative to its maximum: 0 in swing, near 1 for most of the stance."""
    t = cycle.progress
    edge = (2.0 * t - 1.0) ** 2
    return np.where(cycle.swing, 0.0, 1.0 - edge * edge)


def cycloid(progress: Floats) -> tuple[Floats, Floats]:
    """Compute a cycloid: t - sin(2πt)/2π forward and sin²(πt) up.

    The foot has zero velocity at lift-off and at landing.

    Args:
        progress: Progress t of the swing, 0 to 1.

    Returns:
        Fraction of the way over the ground, and fraction of the step height, both in the shape of `progress`.
    """
    turn = 2.0 * np.pi * progress
    return progress - np.sin(turn) / (2.0 * np.pi), 0.5 - 0.5 * np.cos(turn)


def hip_bounce(cycle: LegCycle, swing_time: Floats, stance_time: Floats, bounce: Floats) -> Floats:
    """Compute the bounce of a hip, a height that varies over the leg cycle: up in swing, down in stance.

    For `bounce` 1 the hip flies freely in swing, along g·t·(T - t)/2 at the time t. In stance the hip dips along a
    half-sine with the vertical speed gT/2 at both ends. A smaller `bounce` scales both parts.

    Args:
        cycle: Leg cycle.
        swing_time: Duration T of a swing, s; broadcasts with the cycle.
        stance_time: Duration of a stance, s; broadcasts with the cycle.
        bounce: Scale, 0 to 1; broadcasts with the cycle.

    Returns:
        Height relative to the hip at touch-down and lift-off, m.
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
        progress: Progress, 0 to 1.

    Returns:
        Interpolated value.
    """
    t = progress
    return start + smoothstep(t) * (end - start) + slope * (t * (1.0 - t) * (1.0 - 2.0 * t))
