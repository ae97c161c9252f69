"""Figures of effort for each episode, with their means and intervals."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.catalogue import EFFORT
from evaluate.measures.effort import cost_of_all
from evaluate.statistics.intervals import Floats, Interval, bootstrap_interval

COST = "cost_of_transport"
"""Name of the cost of transport."""
LIMITS = dict.fromkeys(EFFORT, np.inf) | dict.fromkeys(("duty_factor", "flight"), 1.0)
"""Figure of effort -> its largest value."""


def effort_by_episode(column: Callable[[str], NDArray[Any]], weight: float) -> dict[str, Floats]:
    """Compute each figure of EFFORT for each episode.

    Args:
        column: Function that returns a column of `Measures` by its name, (n,) or (n, feet).
        weight: Weight of the robot with its payload, N.

    Returns:
        Figure -> values, (n,). The duty factor is the mean of the feet.
    """
    cost = cost_by_episode(column("energy"), column("distance"), weight)
    duty_factor = column("duty_factor")
    computed = {COST: cost, "duty_factor": duty_factor.reshape(len(duty_factor), -1).mean(axis=1)}
    return {name: computed[name] if name in computed else np.asarray(column(name), np.float64) for name in EFFORT}


def cost_by_episode(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Linearise the cost of transport: return values with the mean ∑ energy / (weight · ∑ distance).

    They are the linearised values of the quotient (Woodruff 1971, Journal of the American Statistical Association 66).
    Intervals and paired differences of the quotient are thereby computed as for any mean.

    Args:
        energy: Energy of each episode, (n,), J.
        distance: Distance of each episode, (n,), m.
        weight: Weight of the robot with its payload, N.

    Returns:
        Values, (n,); NaN where the quotient does not exist.
    """
    total_cost = cost_of_all(energy, distance, weight)
    if np.isnan(total_cost):
        return np.full(len(energy), np.nan)
    return np.asarray(total_cost + (energy - total_cost * weight * distance) / (weight * distance.mean()))


def mean_and_interval(values: Floats, name: str) -> tuple[float, Interval]:
    """Compute mean and 95 % interval of the `values` of the figure `name` that are not NaN."""
    known = values[~np.isnan(values)]
    mean = float(known.mean()) if len(known) else np.nan
    return mean, bootstrap_interval(known, (0.0, LIMITS[name]))
