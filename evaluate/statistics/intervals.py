"""95 % confidence intervals of proportions and means over episodes, and resamples for the bootstrap.

Every bootstrap has a fixed random seed, so that the same episodes always give the same report.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Interval = tuple[float, float]
"""Lower and upper end of a confidence interval, in the unit of the quantity; NaN if not defined."""

CONFIDENCE = 0.95
"""Confidence level of every interval: the probability that it contains the true value."""
UNBOUNDED = (-np.inf, np.inf)
"""Smallest and largest possible value of a quantity that has no limits, for the interval functions."""
RESAMPLES = 9999
"""Number of random resamples of the episodes from which a bootstrap interval is computed."""
MAX_CACHED_VALUES = 12_000_000
"""Largest array of bootstrap resamples that is cached for reuse, as a number of 8-byte values (96 MB).

Larger arrays are drawn again at each use.
"""
BLOCK_VALUES = 500_000
"""Number of values of bootstrap resamples drawn at once if all of them are too large for the cache.

The resamples are drawn in blocks of this size to limit the use of memory.
"""


def wilson_interval(successes: float, trials: float) -> Interval:
    """Compute the 95 % Wilson interval of the proportion `successes` / `trials`; (NaN, NaN) for 0 trials."""
    from scipy.special import ndtri

    if trials == 0:
        return (np.nan, np.nan)
    proportion = successes / trials
    weight = float(ndtri(0.5 + CONFIDENCE / 2)) ** 2 / trials
    centre = proportion + weight / 2
    half_width = np.sqrt(weight * (proportion * (1.0 - proportion) + weight / 4))
    low = (centre - half_width) / (1.0 + weight)
    high = (centre + half_width) / (1.0 + weight)
    return (float(max(0.0, low)), float(min(1.0, high)))


def mean_proportion_interval(proportions: Floats) -> Interval:
    """Compute the 95 % interval of the mean of n independent proportions, (n,), 0 … 1.

    The function computes Wilson's interval for an effective number of yes-or-no trials. With this number of trials, the
    variance of the mean equals the variance that is estimated from the proportions. A factor replaces the quantile of
    the normal distribution by the quantile of Student's t. The method is used for clustered proportions in surveys
    (Korn and Graubard 1998, Survey Methodology 24; with Wilson's interval: Dean and Pagano 2015, Journal of Survey
    Statistics and Methodology 3). If all proportions are equal, they give no estimate of the variance. Each proportion
    then counts as one trial.

    Args:
        proportions: Proportions, for example the fraction of successful scenarios of each of n seeds, (n,), 0 … 1.

    Returns:
        The interval of the mean; (NaN, NaN) for an empty array.
    """
    count = len(proportions)
    if count == 0:
        return (np.nan, np.nan)
    mean = float(proportions.mean())
    trials = float(count)
    if not _are_equal(proportions):
        trials = mean * (1.0 - mean) * count / float(proportions.var(ddof=1))
        trials *= student_trials_factor(count)
    return wilson_interval(mean * trials, trials)


def student_trials_factor(count: int) -> float:
    """Return the factor on an effective number of trials that widens an interval for Student's t.

    The factor replaces the quantile of the normal distribution by the quantile of Student's t for a variance that is
    estimated from `count` independent values, 2 or more.
    """
    from scipy.special import ndtri, stdtrit

    upper = 0.5 + CONFIDENCE / 2
    return float(ndtri(upper) / stdtrit(count - 1, upper)) ** 2


def student_bootstrap_tail(count: int) -> float:
    """Return the percentile, 0 … 1, of the lower end of a bootstrap interval that is widened for Student's t.

    The percentile also corrects the variance of resamples of `count` values, 2 or more, which has `count` instead of
    `count` − 1 in the denominator.
    """
    from scipy.special import ndtr, stdtrit

    return float(ndtr(-np.sqrt(count / (count - 1)) * stdtrit(count - 1, 0.5 + CONFIDENCE / 2)))


def paired_proportion_interval(only_a: int, only_b: int, pairs: int) -> Interval:
    """Compute Tango's 95 % score interval of the difference between two paired proportions, a − b.

    An example is the difference between the success rates of policies a and b in the same episodes. The interval
    consists of the differences that the score form of McNemar's test does not reject (Tango 1998, Statistics in
    Medicine 17). Its width is positive even if a and b agree in every pair; a bootstrap interval would then have the
    width 0.

    Args:
        only_a: Number of pairs (episodes) in which only a is true (succeeds).
        only_b: Number of pairs (episodes) in which only b is true (succeeds).
        pairs: Number of all pairs.

    Returns:
        The interval of the difference, within −1 … 1; (NaN, NaN) for 0 pairs.
    """
    from scipy.optimize import brentq
    from scipy.special import ndtri

    if pairs == 0:
        return (np.nan, np.nan)
    difference = (only_a - only_b) / pairs
    quantile = float(ndtri(0.5 + CONFIDENCE / 2))

    def excess(hypothesis: float, sign: float) -> float:
        """Return Tango's score of a difference minus `sign` · normal quantile; 0 at an end of the interval.

        Args:
            hypothesis: Hypothetical difference between the two proportions, −1 … 1.
            sign: 1 for the lower end of the interval, −1 for the upper end.

        Returns:
            The score minus `sign` · quantile, in standard deviations. A root search finds the hypothesis at which it is
            0.
        """
        return _score(only_a, only_b, pairs, hypothesis) - sign * quantile

    low = brentq(excess, -1.0, difference, args=(1.0,)) if difference > -1.0 else -1.0
    high = brentq(excess, difference, 1.0, args=(-1.0,)) if difference < 1.0 else 1.0
    return (float(low), float(high))


def _score(only_a: int, only_b: int, pairs: int, difference: float) -> float:
    """Return Tango's score of a hypothetical difference between two paired proportions, a − b.

    The score is the observed difference minus the hypothetical difference δ, in standard deviations. The standard
    deviation follows from the expected proportion q of the pairs in which only b is true. It is a root of the equation
    2n q² + B q − b δ(1 − δ) = 0 (Tango's equation 14). In this equation, n is `pairs`, b is `only_b`, and B is the
    linear coefficient.

    Args:
        only_a: Number of pairs in which only a is true.
        only_b: Number of pairs in which only b is true.
        pairs: Number of all pairs.
        difference: Hypothetical difference δ, −1 … 1.

    Returns:
        The score, in standard deviations; infinite if the observed pairs are impossible for this δ.
    """
    if abs(difference) == 1.0:  # A difference of ±1 is possible only if all pairs have the same outcome.
        return float(np.copysign(np.inf, -difference))
    linear = -only_a - only_b + (2 * pairs - only_a + only_b) * difference
    constant = -only_b * difference * (1.0 - difference)
    proportion = (np.sqrt(linear**2 - 8 * pairs * constant) - linear) / (4 * pairs)
    variance = pairs * (2.0 * proportion + difference * (1.0 - difference))
    distance = only_a - only_b - pairs * difference
    if distance == 0.0:
        return 0.0
    return float(distance / np.sqrt(variance)) if variance > 0.0 else float(np.copysign(np.inf, distance))


def bootstrap_interval(values: Floats, bounds: Interval = UNBOUNDED, seed: int = 0) -> Interval:
    """Compute the 95 % bias-corrected and accelerated (BCa) bootstrap interval of the mean of n values.

    Both corrections are needed because falls skew the distribution of errors over episodes. This function gives the
    same interval as `scipy.stats.bootstrap(method="BCa")`. It is four times faster because resamples are cached.

    Args:
        values: Values, for example the velocity error of each episode, (n,). If all are equal, the interval is from
            `identical_values_interval`.
        bounds: Smallest and largest possible value.
        seed: Seed of the random resamples.

    Returns:
        The interval, in the unit of the values; (NaN, NaN) for fewer than two values or if a value is NaN.
    """
    from scipy.special import ndtr, ndtri

    if np.isnan(values).any():
        return (np.nan, np.nan)
    if len(values) < 2 or _are_equal(values):
        return identical_values_interval(values, bounds)
    sums = _resampled_sums(values, RESAMPLES, seed)
    below = (sums < values.sum()).mean()
    not_above = (sums <= values.sum()).mean()
    bias = ndtri((below + not_above) / 2)
    deviation = values - values.mean()
    acceleration = (deviation**3).sum() / (6.0 * (deviation**2).sum() ** 1.5)
    tails = bias + ndtri([0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    low, high = np.quantile(sums, ndtr(bias + tails / (1.0 - acceleration * tails))) / len(values)
    return (float(low), float(high))


def difference_interval(differences: Floats, bounds: Interval = UNBOUNDED, seed: int = 0) -> Interval:
    """Compute the 95 % bootstrap interval of the mean of n paired differences between two policies.

    The ends of the interval are percentiles of the resampled means. The percentiles are chosen for Student's t instead
    of the normal distribution, and for a variance with n − 1 instead of n in the denominator. Both choices widen the
    interval (Hesterberg 2015, The American Statistician 69). The BCa bootstrap is not used, because it would estimate
    the skewness from the few episodes in which one policy fell. Its intervals would contain the true difference in 90 %
    instead of 95 % of all cases (`python -m research calibration`).

    Args:
        differences: Difference in each episode, (n,). If all are equal, the interval is from
            `identical_values_interval`.
        bounds: Smallest and largest possible difference.
        seed: Seed of the random resamples.

    Returns:
        The interval, in the unit of the differences; (NaN, NaN) for fewer than two episodes.
    """
    if len(differences) < 2 or _are_equal(differences):
        return identical_values_interval(differences, bounds)
    pairs = len(differences)
    tail = student_bootstrap_tail(pairs)
    low, high = np.quantile(_resampled_sums(differences, RESAMPLES, seed), [tail, 1.0 - tail]) / pairs
    return (float(low), float(high))


def identical_values_interval(values: Floats, bounds: Interval) -> Interval:
    """Compute the 95 % interval of a population mean if all n values of the sample are equal.

    The population may contain other values that the sample missed. Their largest plausible proportion is the upper end
    of the Wilson interval for 0 successes in n trials, for example 14 % for n = 24. The interval assumes that these
    values can be anywhere within the bounds (after Hanley and Lippman-Hand 1983, JAMA 249).

    Args:
        values: Equal values, for example the velocity error of each episode, (n,).
        bounds: Smallest and largest possible value.

    Returns:
        The interval, in the unit of the values; (NaN, NaN) for fewer than two values.
    """
    if len(values) < 2:
        return (np.nan, np.nan)
    value = float(values.mean())
    low, high = bounds
    unseen = wilson_interval(0, len(values))[1]
    return (value - unseen * (value - low), value + unseen * (high - value))


def _are_equal(values: Floats) -> bool:
    """Return True if all `values`, (n,), are equal up to rounding errors (a relative difference of 1e-9)."""
    return bool(np.ptp(values) <= 1e-9 * np.abs(values).max())


def _resampled_sums(values: Floats, count: int, seed: int) -> Floats:
    """Return the sum of each bootstrap resample of a sample.

    Args:
        values: Values of the sample, (n,).
        count: Number of resamples.
        seed: Seed of the random draws.

    Returns:
        Sum of the n values that each resample draws, (count,).
    """
    return np.concatenate([counts @ values for counts in resamples(len(values), count, seed)])


def percentile_interval(resampled: Floats) -> Interval:
    """Return the 2.5 % and 97.5 % quantiles of a statistic that was computed in each bootstrap resample.

    Args:
        resampled: Value of the statistic in each of m resamples, (m,).

    Returns:
        The percentile interval of the statistic, in its unit.
    """
    low, high = np.quantile(resampled, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    return (float(low), float(high))


def resamples(size: int, count: int, seed: int) -> Iterator[Floats]:
    """Draw bootstrap resamples of a sample, in blocks that limit the use of memory.

    A resample draws `size` values from the sample, with replacement. It is represented by the number of times that each
    value of the sample is drawn, so that `counts @ values` is the sum of the resample.

    Args:
        size: Number of values in the sample and in each resample.
        count: Number of resamples.
        seed: Seed of the random draws.

    Yields:
        Number of times that each value of the sample is drawn, with one row per resample of the block, (rows, size).
    """
    if size * count <= MAX_CACHED_VALUES:
        yield _cached_counts(size, count, seed)
        return
    generator = np.random.default_rng(seed)
    rows = max(1, BLOCK_VALUES // size)
    for first in range(0, count, rows):
        yield _draw_counts(generator, size, min(rows, count - first))


@lru_cache(maxsize=4)
def _cached_counts(size: int, count: int, seed: int) -> Floats:
    """Draw all bootstrap resamples at once, and cache the read-only array for the next call.

    Args:
        size: Number of values in the sample and in each resample.
        count: Number of resamples.
        seed: Seed of the random draws.

    Returns:
        Number of times that each value of the sample is drawn, for each resample, (count, size).
    """
    counts = _draw_counts(np.random.default_rng(seed), size, count)
    counts.flags.writeable = False
    return counts


def _draw_counts(generator: np.random.Generator, size: int, count: int) -> Floats:
    """Draw bootstrap resamples with a random generator.

    Args:
        generator: Random generator.
        size: Number of values in the sample and in each resample.
        count: Number of resamples.

    Returns:
        Number of times that each value of the sample is drawn, for each resample, (count, size).
    """
    indices = generator.integers(0, size, (count, size), dtype=np.int32) + size * np.arange(count)[:, None]
    return np.bincount(indices.ravel(), minlength=count * size).reshape(count, size).astype(np.float64)
