"""Foot paths: dimensionless functions of the gait cycle, and swing trajectories to a foothold.

In the stance phase a foot moves relative to the hip from +1/2 to -1/2 of the stride length at constant speed. In the
swing phase the foot moves back to +1/2. At lift-off and touch-down a swing foot has the velocity of a stance foot, so
that it does not slide on the ground.
"""

import numpy as np

from policies.gait_cycle import Floats, LegCycle, smoothstep
from quad_env.config import GRAVITY


def stride_displacement(cycle: LegCycle, duty: float) -> Floats:
    """Compute the displacement of a foot relative to its hip along the stride, in stride lengths.

    In stance the displacement falls linearly from 1/2 to -1/2. In swing it is a cubic polynomial u(t) of the elapsed
    fraction t, with u(0) = -1/2 and u(1) = 1/2. At both ends, u has the slope of the stance phase, which is -(swing
    time)/(stance time) per unit of t.

    Args:
        cycle: Swing or stance phase of each leg, and its elapsed fraction.
        duty: Duty factor: fraction of the gait cycle that a foot is on the ground.

    Returns:
        Displacement, dimensionless, +0.5 at touch-down and -0.5 at lift-off, in the shape of `cycle.progress`.
    """
    t = cycle.progress
    ratio = (1.0 - duty) / duty
    swing = smoothstep(t) - 0.5 - ratio * (t * (1.0 - t) * (1.0 - 2.0 * t))
    return np.where(cycle.swing, swing, 0.5 - t)


def swing_lift(cycle: LegCycle) -> Floats:
    """Compute the height of each foot as a fraction of the step height: 0 in stance, 1 at mid-swing.

    The vertical velocity is 0 at lift-off and touch-down. The argument `cycle` is the swing or stance phase of each
    leg. The result has the shape of `cycle.progress`.
    """
    t = cycle.progress
    arc = 4.0 * t * (1.0 - t)
    return np.where(cycle.swing, arc * arc, 0.0)


def load_fraction(cycle: LegCycle) -> Floats:
    """Compute the assumed vertical force on each foot, as a fraction of its maximum.

    The fraction is 0 in swing and near 1 for most of the stance phase. It rises from 0 at touch-down and falls to 0 at
    lift-off. The argument `cycle` is the swing or stance phase of each leg. The result has the shape of
    `cycle.progress`.
    """
    t = cycle.progress
    edge = (2.0 * t - 1.0) ** 2
    return np.where(cycle.swing, 0.0, 1.0 - edge * edge)


def cycloid(progress: Floats) -> tuple[Floats, Floats]:
    """Compute the cycloid path of a swing foot: t - sin(2πt)/2π along the step, and sin²(πt) upward.

    The velocity of the foot is zero at lift-off and touch-down.

    Args:
        progress: Elapsed fraction t of the swing phase, 0 to 1.

    Returns:
        Two arrays in the shape of `progress`: covered fraction of the step length, and height as a fraction of the step
        height.
    """
    turn = 2.0 * np.pi * progress
    return progress - np.sin(turn) / (2.0 * np.pi), 0.5 - 0.5 * np.cos(turn)


def hip_bounce(cycle: LegCycle, swing_time: Floats, stance_time: Floats, bounce: Floats) -> Floats:
    """Compute the bounce of a hip: its height over the gait cycle, up in swing and down in stance.

    If `bounce` is 1, the hip follows a free flight in swing: its height is g·t·(T - t)/2 at the time t after lift-off,
    with the gravitational acceleration g. In stance the hip moves down and up along a half sine with the vertical speed
    gT/2 at both ends. For other values of `bounce`, all heights are multiplied by `bounce`.

    Args:
        cycle: Swing or stance phase of each leg, and its elapsed fraction.
        swing_time: Duration T of a swing phase, s; broadcasts with `cycle`.
        stance_time: Duration of a stance phase, s; broadcasts with `cycle`.
        bounce: Scale of the bounce, 0 to 1; broadcasts with `cycle`.

    Returns:
        Height of each hip relative to its height at touch-down and lift-off, m.
    """
    t = cycle.progress
    fall = 0.5 * GRAVITY * bounce * swing_time
    height: Floats = np.where(
        cycle.swing, fall * swing_time * t * (1.0 - t), -fall * stance_time / np.pi * np.sin(np.pi * t)
    )
    return height


def cubic_swing(start: Floats, end: Floats, slope: Floats, progress: Floats) -> Floats:
    """Interpolate from a start to an end value by a cubic polynomial with the same slope at both ends.

    The function computes one coordinate of a swing foot between lift-off and touch-down.

    Args:
        start: Value at progress 0.
        end: Value at progress 1.
        slope: Change of the value per unit of progress at both ends. For a foot, this is the distance that the ground
            moves relative to the trunk during a swing phase.
        progress: Elapsed fraction of the interpolation, 0 to 1.

    Returns:
        Value at `progress`, in the unit of `start`.
    """
    t = progress
    return start + smoothstep(t) * (end - start) + slope * (t * (1.0 - t) * (1.0 - 2.0 * t))
