"""What a residual makes of its authority: pure functions of its correction, in shares of its authority, and its base.

All over (steps, n, 12), upright steps alone, NaN without one.
"""

import numpy as np

from evaluate.measures.averages import Bools, Floats, Recorded, count, over_steps, quotient, upright_mean, upright_share

SATURATED = 0.99
"""Share of the authority from which a correction counts as saturated."""
SLIGHT = 0.05
"""Share of the authority below which a correction has no direction worth the name."""
SLOW = 0.1
"""rad/s of the base's joint target below which the base does not move the joint."""


def authority_used(correction: Recorded, upright: Bools) -> Floats:
    """Mean |correction| over its authority, over joints and time, (n,)."""
    return upright_mean(np.abs(correction.astype(np.float64)).mean(axis=-1), upright)


def authority_saturated(correction: Recorded, upright: Bools) -> Floats:
    """Share of joints and time with the correction at its authority, (n,)."""
    return upright_share(np.abs(correction) >= SATURATED, upright)


def against_base(correction: Recorded, base: Recorded, upright: Bools, dt: float) -> Floats:
    """Share in which the correction opposes the motion of the base's target, (n,), of the joints and time in which
    the base moves and the correction is more than slight; half of it for a correction that ignores the base.

    The first of the steps has none before it and does not count.
    """
    motion = np.diff(base.astype(np.float64), axis=0)
    now = correction[1:]
    counted = (np.abs(motion) >= SLOW * dt) & (np.abs(now) >= SLIGHT) & over_steps(upright[1:], now)
    against = counted & (motion * now < 0)
    return quotient(count(against).sum(axis=-1), count(counted).sum(axis=-1))
