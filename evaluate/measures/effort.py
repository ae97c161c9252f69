"""Measures of the motors' effort; formulas are in `evaluate.measures.catalogue`.

Only upright steps after the first second count. A measure is NaN for an episode that has none of these steps.
"""

import numpy as np

from evaluate.measures.averages import Bools, Floats, Recorded, count, quotient, total, upright_mean, upright_share
from evaluate.measures.episodes import Episodes

ENERGY_RULE = "energy/2"
"""Version of the energy measures, which use every physics step and the torques that joints received."""
MIN_DISTANCE = 1.0
"""Minimum distance of an episode with a cost of transport, m.

The cost of a shorter distance is NaN, because the quotient would be nearly arbitrary.
"""
LIMIT_MARGIN = 0.01
"""Distance from a joint limit within which the joint counts as at the limit, rad."""
SUMS = ("positive_work", "regeneration", "joule_heat")
"""Signals that are summed over time and joints to give a measure of the same name."""


def effort(episodes: Episodes, upright: Bools, distance: Floats) -> dict[str, Floats]:
    """Compute the measures of the motors' effort.

    Args:
        episodes: Recorded episodes.
        upright: True for upright steps, (steps, n).
        distance: Distance covered, (n,), m.

    Returns:
        Name -> measure of each episode, (n,).
    """
    dt = episodes.dt
    settled = slice(episodes.settling, None)
    counted = upright[settled]
    sums = {name: _sum(getattr(episodes, name)[settled], counted) for name in SUMS}
    energy = sums["positive_work"] + sums["regeneration"]
    peak_torque = _peaks(episodes.peak_torque[settled], counted)
    peak_speed = _peaks(episodes.peak_speed[settled], counted)
    action_rate = np.diff(episodes.action[episodes.settling - 1 :].astype(np.float64), axis=0) / dt
    mean_torque = episodes.mean_torque[settled].astype(np.float64).mean(axis=-1)
    torque_change = episodes.torque_change[settled].astype(np.float64).mean(axis=-1)
    is_overspeed = np.abs(episodes.joint_velocity[settled]) > episodes.robot.rated_speed
    return {
        "energy": energy,
        **sums,
        "cost_of_transport": cost_of_transport(energy, distance, episodes.weight),
        "mechanical_power": quotient(energy, count(counted) * dt),
        "peak_torque": peak_torque.max(axis=-1),
        "mean_torque": upright_mean(mean_torque, counted),
        "torque_share": (peak_torque / np.asarray(episodes.torque_limit)).max(axis=-1),
        "speed_share": (peak_speed / np.asarray(episodes.speed_limit)).max(axis=-1),
        "torque_rate": upright_mean(torque_change, counted) / dt,
        "overspeed": upright_share(is_overspeed, counted),
        "action_rate": np.sqrt(upright_mean((action_rate * action_rate).mean(axis=-1), counted)),
    }


def _sum(signal: Recorded, counted: Bools) -> Floats:
    """Return the sum of `signal`, (steps, n, 12), over the counted steps and the joints, (n,)."""
    return total(np.where(counted, signal.astype(np.float64).sum(axis=-1), 0.0))


def _peaks(signal: Recorded, counted: Bools) -> Floats:
    """Return the largest value of each joint in the counted steps, (n, 12); NaN if no step counts."""
    peak = np.where(counted[..., None], signal, -1.0).max(axis=0).astype(np.float64)
    return np.where(peak < 0, np.nan, peak)


def cost_of_transport(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Return the cost of transport: energy / (weight · distance).

    Args:
        energy: Energy of each episode, (n,), J.
        distance: Distance of each episode, (n,), m.
        weight: Weight of the robot and its payload, N.

    Returns:
        Cost of transport, (n,); NaN if the distance is below MIN_DISTANCE.
    """
    return np.where(distance < MIN_DISTANCE, np.nan, energy / (weight * np.maximum(distance, MIN_DISTANCE)))


def cost_of_all(energy: Floats, distance: Floats, weight: float) -> float:
    """Return the cost of transport of several episodes together.

    The result is the total energy over weight times the total distance. It is not a mean of quotients, because an
    episode that commands standing still would dominate that mean.

    Args:
        energy: Energy of each episode, (n,), J.
        distance: Distance of each episode, (n,), m.
        weight: Weight of the robot and its payload, N.

    Returns:
        Cost of transport; NaN if the mean distance is below MIN_DISTANCE.
    """
    (cost,) = cost_of_transport(energy.mean(keepdims=True), distance.mean(keepdims=True), weight)
    return float(cost)
