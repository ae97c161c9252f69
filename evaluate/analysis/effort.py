"""Effort measures of each episode, such as cost of transport and duty factor; means and intervals."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.catalogue import EFFORT
from evaluate.measures.effort import cost_of_all
from evaluate.statistics.intervals import Floats, Interval, bootstrap_interval

COST = "cost_of_transport"
"""Name of the effort measure cost of transport: energy / (weight · distance)."""
LIMITS = dict.fromkeys(EFFORT, np.inf) | dict.fromkeys(("duty_factor", "flight"), 1.0)
"""Name of an effort measure -> its largest possible value, in its unit; infinite if there is no limit.

The confidence interval of the measure does not exceed this value.
"""


def effort_by_episode(column: Callable[[str], NDArray[Any]], weight: float) -> dict[str, Floats]:
    """Compute every effort measure, for example the cost of transport, in each of n episodes.

    Args:
        column: Function that returns the values of a measure for its name (a field of `Measures`). The values have the
            shape (n,), or (n, 4) with one column for each foot.
        weight: Weight of the robot with its payload, N.

    Returns:
        Name of the effort measure, for example `cost_of_transport` -> value in each episode, (n,). The duty factor is
        the mean over the four feet.
    """
    cost = cost_by_episode(column("energy"), column("distance"), weight)
    duty_factor = column("duty_factor")
    computed = {COST: cost, "duty_factor": duty_factor.reshape(len(duty_factor), -1).mean(axis=1)}
    return {name: computed[name] if name in computed else np.asarray(column(name), np.float64) for name in EFFORT}


def cost_by_episode(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Compute a cost of transport for each episode, with the cost of all episodes together as their mean.

    The cost of transport of all episodes together is a quotient of sums: ∑ energy / (weight · ∑ distance). This
    function linearises the quotient (Woodruff 1971, Journal of the American Statistical Association 66), which turns it
    into a mean over the episodes. Confidence intervals and paired differences can then be computed as for a mean.

    Args:
        energy: Mechanical energy of each episode, (n,), J.
        distance: Distance that the robot covered in each episode, (n,), m.
        weight: Weight of the robot with its payload, N.

    Returns:
        Linearised cost of transport of each episode, (n,), without unit; its mean is the cost of all episodes together.
        All values are NaN if the cost of all episodes together is NaN.
    """
    total_cost = cost_of_all(energy, distance, weight)
    if np.isnan(total_cost):
        return np.full(len(energy), np.nan)
    return np.asarray(total_cost + (energy - total_cost * weight * distance) / (weight * distance.mean()))


def mean_and_interval(values: Floats, name: str) -> tuple[float, Interval]:
    """Compute mean and 95 % interval of an effort measure over the episodes in which it is not NaN.

    Args:
        values: Value of the measure in each episode, (n,).
        name: Name of the effort measure, for example `cost_of_transport`. It determines the largest possible value.

    Returns:
        Mean and 95 % bootstrap interval, in the unit of the measure; NaN if every value is NaN.
    """
    known = values[~np.isnan(values)]
    mean = float(known.mean()) if len(known) else np.nan
    return mean, bootstrap_interval(known, (0.0, LIMITS[name]))
