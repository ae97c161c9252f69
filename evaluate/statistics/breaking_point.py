"""Breaking point of a policy: the severity of a disturbance at which half of the episodes fail.

A disturbance, for example pushes, is tested at several severities. The failure rate is the fraction of failed episodes
at one severity. The breaking point is the severity at which a monotone regression of the failure rate crosses one half.
The regression is piecewise linear over the logarithm of severity.

The confidence interval starts at the last severity at which significantly less than half of the episodes fail. It ends
at the first severity at which significantly more than half fail. The tests are exact binomial tests. Severities are
tested in order from the mildest, until a test is not significant, and from the hardest in the same way. Because of this
fixed order, no correction for the number of severities is needed.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from evaluate.statistics.intervals import CONFIDENCE, Bools, Floats, Interval

MIN_LEVELS = 3
"""Minimum number of tested severities of a disturbance from which a breaking point is computed."""

BreakingPointKind = Literal["crossed", "never", "always"]
"""Result of the search for a breaking point (the severity at which half of the episodes fail).

`crossed`: the failure rate crosses one half between the mildest and the hardest severity. `never`: less than half fail
at the hardest severity. `always`: half or more fail at the mildest severity.
"""


@dataclass(frozen=True)
class BreakingPoint:
    """Severity of a disturbance at which half of the episodes of a policy fail, with its interval."""

    found: BreakingPointKind
    """Result of the search for the severity at which half of the episodes fail.

    `crossed`: the failure rate crosses one half between the mildest and the hardest severity. `never`: less than half
    fail at the hardest severity. `always`: half or more fail at the mildest severity.
    """
    severity50: float
    """Severity at which half of the episodes fail, in the unit of the disturbance, for example N·s.

    It is NaN if `found` is `never` or `always`.
    """
    ci: Interval
    """95 % confidence interval of `severity50`, in its unit; an end beyond the tested range is infinite."""


def breaking_point(severities: Floats, failed: Bools) -> BreakingPoint:
    """Compute the severity of a disturbance at which half of the episodes of a policy fail.

    Args:
        severities: Tested severities of the disturbance, the mildest first, (k,).
        failed: True for failed episodes, for each of k severities, the mildest first, and n episodes, (k, n).

    Returns:
        Breaking point with its 95 % confidence interval.

    Raises:
        ValueError: There are fewer than MIN_LEVELS severities, one is negative, or they are not in order.
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
    """Fit a non-decreasing curve of the failure rate over the severity (isotonic regression).

    The curve is linear in ln(severity) between its points. If the failure rate falls from one severity to the next,
    these two severities are merged into one point at their mean. This method is centred isotonic regression (Oron and
    Flournoy 2017, Statistics in Biopharmaceutical Research 9). A severity of 0 is left out because it has no logarithm.

    Args:
        severities: Tested severities of the disturbance, the mildest first, (k,).
        rates: Fraction of failed episodes at each severity, (k,).

    Returns:
        Severities, and failure rates, of the m ≤ k points of the curve, the mildest first, (m,) each.
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
    """Return the indices of the two tested severities between which the failure rate crosses one half.

    At the severity with the first index and at all milder severities, significantly less than half of the episodes
    fail. At the severity with the second index and at all harder severities, significantly more than half fail. Each
    test is a one-sided binomial test with a significance level of 2.5 %.

    Args:
        failed: True for failed episodes, for each of k severities, the mildest first, and n episodes, (k, n).

    Returns:
        The two indices. The first index is −1 if the test at the mildest severity is not significant. The second index
        is k if the test at the hardest severity is not significant.
    """
    from scipy.stats import binom

    tail = (1.0 - CONFIDENCE) / 2.0
    failures = failed.sum(axis=1)
    levels, episodes = failed.shape
    fewer = binom.cdf(failures, episodes, 0.5) <= tail
    more = binom.sf(failures - 1, episodes, 0.5) <= tail
    return int(np.argmin([*fewer, False])) - 1, levels - int(np.argmin([*more[::-1], False]))


def _severity_interval(severities: Floats, levels: tuple[int, int]) -> Interval:
    """Return the interval between the severities with two given indices, the smaller severity first.

    Args:
        severities: Tested severities of a disturbance, the mildest first, (k,).
        levels: Index of the milder severity and index of the harder severity. An index of −1 or k stands for a severity
            beyond the mildest or the hardest one.

    Returns:
        Lower and upper end of the interval, in the unit of the severities; infinite for an index of −1 or k.
    """
    is_rising = severities[-1] > severities[0]
    beyond_hardest = np.inf if is_rising else -np.inf
    padded = [*severities.tolist(), beyond_hardest, -beyond_hardest]  # Index −1 and index k read ±∞.
    low, high = sorted((padded[levels[0]], padded[levels[1]]))
    return (low, high)
