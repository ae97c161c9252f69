"""Breaking points: the severity of an axis at which half of the episodes fail.

The figure is where a monotone regression, straight over the logarithm of severity between the levels, crosses one
half. The interval reaches from the last level at which an exact test shows that fewer than half fail to the first at
which it shows that more do. Levels are tested from the mildest up to the first that fails its test, and from the
hardest down in the same way, so that many levels cost no correction.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from evaluate.statistics.intervals import CONFIDENCE, Bools, Floats, Interval

LEAST_LEVELS = 3
"""Severities below which there is no breaking point."""

Found = Literal["crossed", "never", "always"]


@dataclass(frozen=True)
class BreakingPoint:
    """Where a policy breaks, and where it might."""

    found: Found
    """`crossed`; `never`: less than half fail at the hardest level; `always`: half or more fail at the mildest."""
    severity50: float
    """NaN unless crossed."""
    ci: Interval
    """95 %; an infinite end lies beyond the levels tried."""


def breaking_point(severities: Floats, failed: Bools) -> BreakingPoint:
    """From failures (k, n) at severities (k,), the mildest first; ValueError for too few or for some out of order."""
    steps = np.diff(severities)
    if len(severities) < LEAST_LEVELS or severities.min() < 0.0 or not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError(f"a breaking point takes {LEAST_LEVELS} or more severities from the mildest to the hardest")
    ci = _severities(severities, bracket(failed))
    x, rates = monotone_curve(severities, failed.mean(axis=1))
    if rates[0] >= 0.5 or rates[-1] < 0.5:
        return BreakingPoint("always" if rates[0] >= 0.5 else "never", np.nan, ci)
    point = np.exp(np.interp(0.5, rates, np.log(x)))
    return BreakingPoint("crossed", float(np.clip(point, *ci)), ci)


def monotone_curve(severities: Floats, rates: Floats) -> tuple[Floats, Floats]:
    """Severities and shares between which the curve of failures is straight over ln(severity), the mildest first.

    Centred isotonic regression (Oron and Flournoy 2017, Statistics in Biopharmaceutical Research 9): levels whose order
    is the wrong way round become one, at their mean. A severity of 0 is no disturbance and has no logarithm.
    """
    from scipy.optimize import isotonic_regression

    known = severities > 0.0
    x, fitted = np.log(severities[known]), isotonic_regression(rates[known])
    points: list[tuple[float, float]] = []
    for first, end in pairwise(fitted.blocks):
        share = float(fitted.x[first])
        middle = [x[first:end].mean()] if 0.0 < share < 1.0 else x[first:end]
        points += [(float(each), share) for each in middle]
    logarithms, shares = np.array(points).T
    return np.exp(logarithms), shares


def bracket(failed: Bools) -> tuple[int, int]:
    """Numbers of the levels, of (k, n), between which half fail; −1 and k lie beyond them.

    The test is the binomial one, with a chance of an error of 2.5 % on either side.
    """
    from scipy.stats import binom

    tail = (1.0 - CONFIDENCE) / 2.0
    fails, (levels, episodes) = failed.sum(axis=1), failed.shape
    fewer = binom.cdf(fails, episodes, 0.5) <= tail
    more = binom.sf(fails - 1, episodes, 0.5) <= tail
    return int(np.argmin([*fewer, False])) - 1, levels - int(np.argmin([*more[::-1], False]))


def _severities(severities: Floats, levels: tuple[int, int]) -> Interval:
    """Those of two levels in their order; an infinite end for what lies beyond."""
    rising = severities[-1] > severities[0]
    padded = [*(float(each) for each in severities), np.inf if rising else -np.inf, -np.inf if rising else np.inf]
    low, high = sorted((padded[levels[0]], padded[levels[1]]))
    return (low, high)
