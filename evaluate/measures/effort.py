"""What the motors do, and what a residual makes of its authority; formulas stand in `evaluate.measures.catalogue`.

Upright steps after the first second alone, NaN without one.
"""

import numpy as np

from evaluate.measures.averages import Bools, Floats, Recorded, count, quotient, total, upright_mean, upright_share
from evaluate.measures.episodes import Episodes

ENERGY_RULE = "energy/2"
"""How energy, torques and their shares are measured: of every physics step, with torques as the joints received them.
"""
SHORTEST_DISTANCE = 1.0
"""Below this distance an episode has no cost of transport, m: it would be a quotient by nearly nothing."""
LIMIT_MARGIN = 0.01
"""rad from a joint limit at which the joint counts as at it."""
SUMS = "positive_work", "regeneration", "joule_heat"
"""Sums over time and joints."""


def effort(episodes: Episodes, upright: Bools, distance: Floats) -> dict[str, Floats]:
    """Every measure of what the motors do over a distance, (n,) m."""
    robot, dt, settled = episodes.robot, episodes.dt, slice(episodes.settling, None)
    speed, counted = episodes.joint_velocity[settled], upright[settled]
    sums = {name: _sum(getattr(episodes, name)[settled], counted) for name in SUMS}
    energy = sums["positive_work"] + sums["regeneration"]
    peak, fastest = (_peaks(signal[settled], counted) for signal in (episodes.peak_torque, episodes.peak_speed))
    rate = np.diff(episodes.action[episodes.settling - 1 :].astype(np.float64), axis=0) / dt
    mean_torque, change = (
        signal[settled].astype(np.float64).mean(axis=-1) for signal in (episodes.mean_torque, episodes.torque_change)
    )
    return {
        "energy": energy,
        **sums,
        "cost_of_transport": cost_of_transport(energy, distance, episodes.weight),
        "mechanical_power": quotient(energy, count(counted) * dt),
        "peak_torque": peak.max(axis=-1),
        "mean_torque": upright_mean(mean_torque, counted),
        "torque_share": (peak / np.asarray(episodes.torque_limit)).max(axis=-1),
        "speed_share": (fastest / np.asarray(episodes.speed_limit)).max(axis=-1),
        "torque_rate": upright_mean(change, counted) / dt,
        "overspeed": upright_share(np.abs(speed) > robot.rated_speed, counted),
        "action_rate": np.sqrt(upright_mean((rate * rate).mean(axis=-1), counted)),
    }


def _sum(signal: Recorded, counted: Bools) -> Floats:
    """Of the counted steps and all joints, (n,)."""
    return total(np.where(counted, signal.astype(np.float64).sum(axis=-1), 0.0))


def _peaks(signal: Recorded, counted: Bools) -> Floats:
    """Largest value of each joint in the counted steps, (n, 12); NaN without one."""
    peak = np.where(counted[..., None], signal, -1.0).max(axis=0).astype(np.float64)
    return np.where(peak < 0, np.nan, peak)


def cost_of_transport(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Energy over weight times distance; NaN below SHORTEST_DISTANCE."""
    return np.where(distance < SHORTEST_DISTANCE, np.nan, energy / (weight * np.maximum(distance, SHORTEST_DISTANCE)))


def cost_of_all(energy: Floats, distance: Floats, weight: float) -> float:
    """Cost of transport of episodes together, of the energy, (n,) J, and the distance, (n,) m, of each.

    A quotient of sums: an episode that commands standing still adds its energy, and dominates no mean of quotients.
    """
    (whole,) = cost_of_transport(energy.mean(keepdims=True), distance.mean(keepdims=True), weight)
    return float(whole)
