"""Breaking points: the severity of an axis at which half of the episodes fail.

A level is one severity of the axis. The breaking point is the severity at which a monotone regression of the failure
rate crosses one half. The regression is piecewise linear over the logarithm of severity. Its interval starts at the
last level at which significantly less than half of the episodes fail. It ends at the first level at which significantly
more than half fail. The tests are exact. Levels are tested in order, from the mildest until a level is not significant,
and from the hardest in the same way. This fixed order makes a correction for the number of levels unnecessary.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from evaluate.statistics.intervals import CONFIDENCE, Bools, Floats, Interval

MIN_LEVELS = 3
"""Minimum number of severities from which a breaking point is computed."""

BreakingPointKind = Literal["crossed", "never", "always"]
"""Result of the search for a breaking point; see `BreakingPoint.found`."""


@dataclass(frozen=True)
class BreakingPoint:
    """Breaking point of a policy on an axis, made by `breaking_point`."""

    found: BreakingPointKind
    """Where the failure rate crosses one half.

    `crossed`: between the mildest and the hardest level. `never`: less than half fail at the hardest level. `always`:
    half or more fail at the mildest level.
    """
    severity50: float
    """Severity at which half of the episodes fail; NaN if `found` is `never` or `always`."""
    ci: Interval
    """95 % interval of the severity; an end is infinite if it lies beyond the tested levels."""


def breaking_point(severities: Floats, failed: Bools) -> BreakingPoint:
    """Compute the breaking point of one policy on one axis.

    Args:
        severities: Severities, the mildest first, (k,).
        failed: True for each failed one of n episodes at each severity, (k, n).

    Returns:
        Breaking point and interval.

    Raises:
        ValueError: There are too few severities, or they are out of order.
    """
    steps = np.diff(severities)
    if len(severities) < MIN_LEVELS or severities.min() < 0.0 or not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError(f"a breaking point takes {MIN_LEVELS} or more severities from the mildest to the hardest")
    ci = _severity_interval(severities, bracket_levels(failed))
    x, rates = monotone_curve(severities, failed.mean(axis=1))
    if rates[0] >= 0.5 or rates[-1] < 0.5:
        return BreakingPoint("always" if rates[0] >= 0.5 else "never", np.nan, ci)
    point = np.exp(np.interp(0.5, rates, np.log(x)))
    return BreakingPoint("crossed", float(np.clip(point, *ci)), ci)


def monotone_curve(severities: Floats, rates: Floats) -> tuple[Floats, Floats]:
    """Fit a monotone curve of failure rate over severity by centred isotonic regression.

    The curve is linear in ln(severity) between its points. Neighbouring levels with decreasing failure rates are merged
    into one point at their mean (Oron and Flournoy 2017, Statistics in Biopharmaceutical Research 9). A severity of 0
    is left out because it has no logarithm.

    Args:
        severities: Severities, the mildest first, (k,).
        rates: Proportion of failed episodes at each severity, (k,).

    Returns:
        Severities and failure rates of the points of the curve, the mildest first.
    """
    from scipy.optimize import isotonic_regression

    positive = severities > 0.0
    log_severities = np.log(severities[positive])
    fitted = isotonic_regression(rates[positive])
    points: list[tuple[float, float]] = []
    for first, end in pairwise(fitted.blocks):
        rate = float(fitted.x[first])
        block = log_severities[first:end]
        centres = [block.mean()] if 0.0 < rate < 1.0 else block
        points += [(float(centre), rate) for centre in centres]
    curve_severities, curve_rates = np.array(points).T
    return np.exp(curve_severities), curve_rates


def bracket_levels(failed: Bools) -> tuple[int, int]:
    """Return the indices of the two levels between which the failure rate crosses one half.

    At the first index and at all milder levels, significantly less than half of the episodes fail. At the second index
    and at all harder levels, significantly more than half fail. Each test is binomial, one-sided, at a level of 2.5 %.

    Args:
        failed: True for each failed one of n episodes at each of k levels, the mildest first, (k, n).

    Returns:
        The two indices. The first is −1 if no mild level is significant; the second is k if no hard level is.
    """
    from scipy.stats import binom

    tail = (1.0 - CONFIDENCE) / 2.0
    failures = failed.sum(axis=1)
    levels, episodes = failed.shape
    fewer = binom.cdf(failures, episodes, 0.5) <= tail
    more = binom.sf(failures - 1, episodes, 0.5) <= tail
    return int(np.argmin([*fewer, False])) - 1, levels - int(np.argmin([*more[::-1], False]))


def _severity_interval(severities: Floats, levels: tuple[int, int]) -> Interval:
    """Return the severities of two level indices in ascending order; infinite for an index of −1 or k."""
    is_rising = severities[-1] > severities[0]
    beyond_hardest = np.inf if is_rising else -np.inf
    padded = [*severities.tolist(), beyond_hardest, -beyond_hardest]  # index −1 reads the last entry
    low, high = sorted((padded[levels[0]], padded[levels[1]]))
    return (low, high)
