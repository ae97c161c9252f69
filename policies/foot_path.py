"""The path of a foot relative to the body over one cycle, as dimensionless shapes of a leg's progress.

A stride carries the foot from +1/2 to -1/2 of its length at constant speed in stance, and back in swing. The swing
leaves the ground with the velocity that the stance ended with and lands with the velocity that the next one starts
with, so a foot that moves with the ground neither scuffs at lift-off nor brakes at touch-down.
"""

import numpy as np

from policies.gait import Floats, LegCycle


def stride(cycle: LegCycle, duty: float) -> Floats:
    """Displacement along the stride, in stride lengths; +0.5 at touch-down, -0.5 at lift-off; shape of the cycle.

    In swing the cubic with u(0) = -1/2, u(1) = 1/2 and the stance's own slope at both ends: per unit of swing progress
    that slope is -r, with r = (swing time)/(stance time).
    """
    t = cycle.progress
    ratio = (1.0 - duty) / duty
    swing = t * t * (3.0 - 2.0 * t) - 0.5 - ratio * (t * (1.0 - t) * (1.0 - 2.0 * t))
    path: Floats = np.where(cycle.swing, swing, 0.5 - t)
    return path


def lift(cycle: LegCycle) -> Floats:
    """Height above the ground, in step heights: 0 in stance, 1 at mid-swing, level at both ends; shape of the cycle."""
    t = cycle.progress
    arc = 4.0 * t * (1.0 - t)
    height: Floats = np.where(cycle.swing, arc * arc, 0.0)
    return height


def load(cycle: LegCycle) -> Floats:
    """Share of its load that a foot carries: 0 in swing, 1 for most of the stance; shape of the cycle."""
    t = cycle.progress
    edge = (2.0 * t - 1.0) ** 2
    share: Floats = np.where(cycle.swing, 0.0, 1.0 - edge * edge)
    return share
