"""Figures of effort, episode by episode, with their means and intervals."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.catalogue import EFFORT
from evaluate.measures.effort import cost_of_all
from evaluate.statistics.intervals import Floats, Interval, bootstrap_interval

COST = "cost_of_transport"
LIMITS = dict.fromkeys(EFFORT, np.inf) | dict.fromkeys(("duty_factor", "flight"), 1.0)
"""Largest value of each figure."""


def effort_by_episode(column: Callable[[str], NDArray[Any]], weight: float) -> dict[str, Floats]:
    """Each of EFFORT of each episode, (n,), from the columns of `Measures`; the duty factor is the mean of the feet."""
    cost = cost_by_episode(column("energy"), column("distance"), weight)
    duty = column("duty_factor")
    known = {COST: cost, "duty_factor": duty.reshape(len(duty), -1).mean(axis=1)}
    return {name: known[name] if name in known else np.asarray(column(name), np.float64) for name in EFFORT}


def cost_by_episode(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Values, (n,), whose mean is the cost of transport of all episodes, ∑ energy / (weight · ∑ distance).

    They are the quotient's linearised values (Woodruff 1971, Journal of the American Statistical Association 66), so
    that its intervals and paired differences are those of any mean. NaN where the quotient does not exist.
    """
    whole = cost_of_all(energy, distance, weight)
    if np.isnan(whole):
        return np.full(len(energy), np.nan)
    return np.asarray(whole + (energy - whole * weight * distance) / (weight * distance.mean()))


def mean_and_interval(values: Floats, name: str) -> tuple[float, Interval]:
    """Mean and 95 % interval over the episodes that have that figure; NaN without one."""
    known = values[~np.isnan(values)]
    mean = float(known.mean()) if len(known) else np.nan
    return mean, bootstrap_interval(known, (0.0, LIMITS[name]))
