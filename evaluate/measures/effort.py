"""Measures of motor effort, such as energy and cost of transport.

`evaluate.measures.catalogue` contains their formulas. Only the control steps after the first second and before a fall
enter a measure. The measure is NaN for an episode that has none of these steps.
"""

import numpy as np

from evaluate.measures.averages import Bools, Floats, Recorded, count, quotient, total, upright_mean, upright_share
from evaluate.measures.episodes import Episodes

ENERGY_RULE = "energy/2"
"""Version of the rule that computes the energy measures from the joint torques in every physics step."""
MIN_DISTANCE = 1.0
"""Minimum distance of an episode for which a cost of transport is computed, m.

The cost over a shorter distance is NaN, because the quotient energy / distance would be nearly arbitrary.
"""
LIMIT_MARGIN = 0.01
"""Largest distance to a joint limit at which a joint counts as being at the limit, rad."""
SUMS = ("positive_work", "regeneration", "joule_heat")
"""Names of the signals, J, for which the sum over time and joints is a measure of the same name, J."""


def effort(episodes: Episodes, upright: Bools, distance: Floats) -> dict[str, Floats]:
    """Compute the measures of motor effort, such as energy and cost of transport.

    Args:
        episodes: Recorded episodes.
        upright: True for control steps before the robot's fall, (steps, n).
        distance: Distance that the robot covered in each episode, (n,), m.

    Returns:
        Name of the measure -> value of each episode, (n,).
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
    """Return the sum of `signal`, (steps, n, 12), over all joints and the counted control steps, (n,).

    `counted`, (steps, n), is True for the control steps that enter the sum.
    """
    return total(np.where(counted, signal.astype(np.float64).sum(axis=-1), 0.0))


def _peaks(signal: Recorded, counted: Bools) -> Floats:
    """Return the largest value of a joint signal, for each joint, in the counted control steps.

    Args:
        signal: Signal that is not negative, (steps, n, 12).
        counted: True for the control steps that enter the maximum, (steps, n).

    Returns:
        Maxima, (n, 12), in the unit of the signal; NaN if no step of an episode is counted.
    """
    peak = np.where(counted[..., None], signal, -1.0).max(axis=0).astype(np.float64)
    return np.where(peak < 0, np.nan, peak)


def cost_of_transport(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Return the cost of transport of each episode: energy / (weight · distance), dimensionless.

    Args:
        energy: Mechanical energy of each episode, (n,), J.
        distance: Distance that the robot covered in each episode, (n,), m.
        weight: Weight of the robot with its payload, N.

    Returns:
        Cost of transport, (n,); NaN if the distance is below MIN_DISTANCE.
    """
    return np.where(distance < MIN_DISTANCE, np.nan, energy / (weight * np.maximum(distance, MIN_DISTANCE)))


def cost_of_all(energy: Floats, distance: Floats, weight: float) -> float:
    """Return the cost of transport of several episodes together, dimensionless.

    It is the total energy divided by the product of weight and total distance. It is not a mean over the episodes,
    because an episode with a command to stand still would dominate the mean.

    Args:
        energy: Mechanical energy of each episode, (n,), J.
        distance: Distance that the robot covered in each episode, (n,), m.
        weight: Weight of the robot with its payload, N.

    Returns:
        Cost of transport; NaN if the mean distance is below MIN_DISTANCE.
    """
    (cost,) = cost_of_transport(energy.mean(keepdims=True), distance.mean(keepdims=True), weight)
    return float(cost)
