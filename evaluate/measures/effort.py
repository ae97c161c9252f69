"""What the motors do: pure functions over (steps, n, 12) joint signals, upright steps alone, NaN without one."""

import numpy as np

from evaluate.measures.averages import Bools, Floats, Recorded, total, upright_mean, upright_share

SHORTEST_DISTANCE = 1.0
"""Below this distance an episode has no cost of transport, m: it would be a quotient by nearly nothing."""
LIMIT_MARGIN = 0.01
"""rad from a joint limit at which the joint counts as at it."""
SATURATED = 0.999
"""Share of the torque limit from which a torque counts as saturated."""


def mechanical_power(torque: Recorded, speed: Recorded) -> Floats:
    """Σ |torque · joint speed|, (steps, n), W."""
    return np.asarray(np.abs(torque * speed.astype(np.float64)).sum(axis=-1))


def energy(power: Floats, upright: Bools, dt: float) -> Floats:
    """Integral of the power, (n,) J."""
    return total(np.where(upright, power, 0.0)) * dt


def mean_power(power: Floats, upright: Bools) -> Floats:
    """Mean of the power, (n,) W."""
    return upright_mean(power, upright)


def cost_of_transport(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Energy over weight times distance; NaN below SHORTEST_DISTANCE."""
    return np.where(distance < SHORTEST_DISTANCE, np.nan, energy / (weight * np.maximum(distance, SHORTEST_DISTANCE)))


def peak_torque(torque: Recorded, upright: Bools) -> Floats:
    """Largest |torque| of any joint, (n,) N·m."""
    peak = np.where(upright, np.abs(torque).max(axis=-1), -1.0).max(axis=0).astype(np.float64)
    return np.where(peak < 0, np.nan, peak)


def mean_torque(torque: Recorded, upright: Bools) -> Floats:
    """Mean |torque| over joints and time, (n,) N·m."""
    return upright_mean(np.abs(torque.astype(np.float64)).mean(axis=-1), upright)


def torque_saturation(torque: Recorded, limit: float, upright: Bools) -> Floats:
    """Share of joints and time with the torque at its limit, (n,)."""
    return upright_share(np.abs(torque) >= SATURATED * limit, upright)


def joint_limit(angle: Recorded, lower: Floats, upper: Floats, upright: Bools) -> Floats:
    """Share of joints and time at a joint limit, or beyond it, (n,); `lower` and `upper` are the limits, (12,), rad."""
    low, high = lower + LIMIT_MARGIN, upper - LIMIT_MARGIN
    return upright_share((angle <= low.astype(np.float32)) | (angle >= high.astype(np.float32)), upright)


def overspeed(speed: Recorded, rated: float, upright: Bools) -> Floats:
    """Share of joints and time above the rated joint speed, rad/s, (n,)."""
    return upright_share(np.abs(speed) > rated, upright)


def action_rate(action: Recorded, upright: Bools, dt: float) -> Floats:
    """Root mean square, over joints and time, of the speed of the joint targets, (n,) rad/s.

    The first of the steps has none before it and does not count.
    """
    rate = np.diff(action.astype(np.float64), axis=0) / dt
    return np.sqrt(upright_mean((rate * rate).mean(axis=-1), upright[1:]))
