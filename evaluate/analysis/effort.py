"""Effort measures of each episode (cost of transport, duty factor, …), with means and intervals."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.catalogue import EFFORT
from evaluate.measures.effort import cost_of_all
from evaluate.statistics.intervals import Floats, Interval, bootstrap_interval

COST = "cost_of_transport"
"""Name of the cost of transport in EFFORT."""
LIMITS = dict.fromkeys(EFFORT, np.inf) | dict.fromkeys(("duty_factor", "flight"), 1.0)
"""Effort measure -> its largest possible value."""


def effort_by_episode(column: Callable[[str], NDArray[Any]], weight: float) -> dict[str, Floats]:
    """Compute every effort measure of each episode.

    Args:
        column: Function from the name of a measure in `Measures` to its values, (n,) or (n, feet).
        weight: Weight of the robot with its payload, N.

    Returns:
        Name in EFFORT -> value of each episode, (n,). The duty factor is the mean over the feet.
    """
    cost = cost_by_episode(column("energy"), column("distance"), weight)
    duty_factor = column("duty_factor")
    computed = {COST: cost, "duty_factor": duty_factor.reshape(len(duty_factor), -1).mean(axis=1)}
    return {name: computed[name] if name in computed else np.asarray(column(name), np.float64) for name in EFFORT}


def cost_by_episode(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Linearise the cost of transport: one value per episode, with the cost of all episodes as mean.

    The cost of transport of all episodes is a quotient of sums: ∑ energy / (weight · ∑ distance). Linearisation
    (Woodruff 1971, Journal of the American Statistical Association 66) makes it a mean over episodes. Its interval and
    its paired differences can then be computed in the same way as for any mean.

    Args:
        energy: Energy of each episode, (n,), J.
        distance: Distance of each episode, (n,), m.
        weight: Weight of the robot with its payload, N.

    Returns:
        Linearised cost of each episode, (n,); all NaN if the cost of transport is not defined.
    """
    total_cost = cost_of_all(energy, distance, weight)
    if np.isnan(total_cost):
        return np.full(len(energy), np.nan)
    return np.asarray(total_cost + (energy - total_cost * weight * distance) / (weight * distance.mean()))


def mean_and_interval(values: Floats, name: str) -> tuple[float, Interval]:
    """Compute mean and 95 % interval of an effort measure over the episodes in which it is not NaN.

    Args:
        values: Value of each episode, (n,).
        name: Name of the measure in EFFORT.

    Returns:
        Mean and interval; NaN if every value is NaN.
    """
    known = values[~np.isnan(values)]
    mean = float(known.mean()) if len(known) else np.nan
    return mean, bootstrap_interval(known, (0.0, LIMITS[name]))
