"""Breaking points: the severity of an axis at which half of the episodes fail.

The breaking point is where a monotone regression crosses one half; between the levels it is straight over the logarithm
of severity. The interval reaches from the last level with significantly fewer failures than one half to the first level
with significantly more, by exact tests. Levels are tested from the mildest up to the first that fails its test, and in
the same way from the hardest down. Many levels therefore need no correction.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from evaluate.statistics.intervals import CONFIDENCE, Bools, Floats, Interval

MIN_LEVELS = 3
"""Minimum number of severities for a breaking point."""

BreakingPointKind = Literal["crossed", "never", "always"]
"""Position of a breaking point relative to the levels."""


@dataclass(frozen=True)
class BreakingPoint:
    """Breaking point of a policy on an axis, made by `breaking_point`."""

    found: BreakingPointKind
    """`crossed`; `never`: less than half fail at the hardest level; `always`: half or more fail at the mildest."""
    severity50: float
    """Severity at which half of the episodes fail; NaN unless crossed."""
    ci: Interval
    """95 % interval; an infinite end lies beyond the levels."""


def breaking_point(severities: Floats, failed: Bools) -> BreakingPoint:
    """Compute the breaking point of an axis.

    Args:
        severities: Severities, (k,), the mildest first.
        failed: Failures of n episodes at each severity, (k, n).

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
    """Fit a monotone curve of failures by centred isotonic regression.

    The curve is straight over ln(severity) between its points. Levels in the wrong order are merged into one at their
    mean (Oron and Flournoy 2017, Statistics in Biopharmaceutical Research 9). A severity of 0 is no disturbance, has no
    logarithm, and is left out.

    Args:
        severities: Severities, (k,), the mildest first.
        rates: Proportion of failures at each, (k,).

    Returns:
        Severities and proportions of failures at the points of the curve, the mildest first.
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
    """Return the indices of the levels, of (k, n) failures, between which half of the episodes fail.

    −1 and k lie beyond the levels. The test is binomial, with an error probability of 2.5 % on either side.
    """
    from scipy.stats import binom

    tail = (1.0 - CONFIDENCE) / 2.0
    failures = failed.sum(axis=1)
    levels, episodes = failed.shape
    fewer = binom.cdf(failures, episodes, 0.5) <= tail
    more = binom.sf(failures - 1, episodes, 0.5) <= tail
    return int(np.argmin([*fewer, False])) - 1, levels - int(np.argmin([*more[::-1], False]))


def _severity_interval(severities: Floats, levels: tuple[int, int]) -> Interval:
    """Return the severities of two levels in ascending order; an end beyond the levels is infinite."""
    is_rising = severities[-1] > severities[0]
    beyond_hardest = np.inf if is_rising else -np.inf
    padded = [*severities.tolist(), beyond_hardest, -beyond_hardest]  # index −1 is beyond the mildest
    low, high = sorted((padded[levels[0]], padded[levels[1]]))
    return (low, high)
