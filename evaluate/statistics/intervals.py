"""95 % confidence intervals of proportions and means, and the resamples of all bootstraps.

Every bootstrap has a fixed seed, so that the same episodes always give the same report.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Interval = tuple[float, float]
"""Lower and upper end of an interval."""

CONFIDENCE = 0.95
"""Confidence level of every interval."""
UNBOUNDED = (-np.inf, np.inf)
"""Smallest and largest possible value of a quantity that has no limits."""
RESAMPLES = 9999
"""Number of resamples of a bootstrap."""
MAX_CACHED_VALUES = 12_000_000
"""Largest set of resamples that is drawn once and reused, number of values (96 MB)."""
BLOCK_VALUES = 500_000
"""Number of values drawn at once from a set that is too large for the cache.

The block size limits the memory, because a large set is drawn again at each use.
"""


def wilson_interval(successes: float, trials: float) -> Interval:
    """Compute the Wilson interval of the proportion `successes` / `trials`; (NaN, NaN) for 0 trials."""
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
    """Compute the interval of the mean of independent proportions in 0 … 1; (NaN, NaN) for an empty array.

    The interval is Wilson's, for an effective number of yes-or-no trials. This number gives the mean the variance that
    the proportions show; Student's t replaces the normal distribution. The method is used for clustered proportions in
    surveys (Korn and Graubard 1998, Survey Methodology 24; with Wilson's interval: Dean and Pagano 2015, Journal of
    Survey Statistics and Methodology 3). Each proportion counts as one trial if all are equal, because equal
    proportions give no estimate of their variance.
    """
    from scipy.special import ndtri, stdtrit

    count = len(proportions)
    if count == 0:
        return (np.nan, np.nan)
    mean = float(proportions.mean())
    trials = float(count)
    if not _are_equal(proportions):
        upper = 0.5 + CONFIDENCE / 2
        trials = mean * (1.0 - mean) * count / float(proportions.var(ddof=1))
        trials *= float(ndtri(upper) / stdtrit(count - 1, upper)) ** 2
    return wilson_interval(mean * trials, trials)


def paired_proportion_interval(only_a: int, only_b: int, pairs: int) -> Interval:
    """Compute Tango's score interval of the difference of two paired proportions, a − b.

    The interval inverts the score form of McNemar's test, as Wilson's interval inverts the test of one proportion
    (Tango 1998, Statistics in Medicine 17). Its width is positive even if a and b agree in every pair. A bootstrap
    interval would then have no width and would claim certainty.

    Args:
        only_a: Number of pairs in which a alone is true.
        only_b: Number of pairs in which b alone is true.
        pairs: Number of all pairs.

    Returns:
        The interval; (NaN, NaN) for 0 pairs.
    """
    from scipy.optimize import brentq
    from scipy.special import ndtri

    if pairs == 0:
        return (np.nan, np.nan)
    difference = (only_a - only_b) / pairs
    quantile = float(ndtri(0.5 + CONFIDENCE / 2))

    def excess(hypothesis: float, sign: float) -> float:
        """Return the score at a hypothetical difference minus `sign` · quantile; 0 at an interval end."""
        return _score(only_a, only_b, pairs, hypothesis) - sign * quantile

    low = brentq(excess, -1.0, difference, args=(1.0,)) if difference > -1.0 else -1.0
    high = brentq(excess, difference, 1.0, args=(-1.0,)) if difference < 1.0 else 1.0
    return (float(low), float(high))


def _score(only_a: int, only_b: int, pairs: int, difference: float) -> float:
    """Return Tango's score: observed minus hypothetical difference, in standard deviations.

    Under the hypothesis, the expected proportion q of `only_b` solves 2n q² + B q − b δ(1 − δ) = 0 (Tango's
    equation 14). There n is `pairs`, b is `only_b`, δ is `difference`, and B is `linear`.
    """
    if abs(difference) == 1.0:  # because a difference of ±1 allows only one outcome in every pair
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
    """Compute the bias-corrected and accelerated (BCa) bootstrap interval of a mean.

    The correction is needed because falls skew the distribution of errors over episodes. This function returns the
    interval of `scipy.stats.bootstrap(method="BCa")`; its cached resamples make it four times faster.

    Args:
        values: Values, (n,). If all are equal, the interval is from `identical_values_interval`.
        bounds: Smallest and largest possible value.
        seed: Seed of the resamples.

    Returns:
        The interval; (NaN, NaN) for fewer than two values or if a value is NaN.
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
    """Compute the bootstrap interval of the mean of paired differences.

    The ends are percentiles of the resampled means. The percentiles are widened from the normal distribution to
    Student's t, and from n to n − 1 (Hesterberg 2015, The American Statistician 69). BCa is not used, because its
    skewness would come from the few episodes in which one policy fell. Its intervals would cover 90 % instead of 95 %
    (`python -m research calibration`).

    Args:
        differences: Paired differences, (n,). If all are equal, the interval is from `identical_values_interval`.
        bounds: Smallest and largest possible difference.
        seed: Seed of the resamples.

    Returns:
        The interval; (NaN, NaN) for fewer than two pairs.
    """
    from scipy.special import ndtr, stdtrit

    if len(differences) < 2 or _are_equal(differences):
        return identical_values_interval(differences, bounds)
    pairs = len(differences)
    tail = ndtr(-np.sqrt(pairs / (pairs - 1)) * stdtrit(pairs - 1, 0.5 + CONFIDENCE / 2))
    low, high = np.quantile(_resampled_sums(differences, RESAMPLES, seed), [tail, 1.0 - tail]) / pairs
    return (float(low), float(high))


def identical_values_interval(values: Floats, bounds: Interval) -> Interval:
    """Compute the interval of the mean of a population from which n equal values were drawn.

    Different values may exist that the sample missed. Their largest plausible proportion is the upper Wilson limit for
    0 successes in n trials, for example 14 % for n = 24. The interval allows them to lie anywhere within the bounds
    (after Hanley and Lippman-Hand 1983, JAMA 249).

    Args:
        values: Equal values, (n,).
        bounds: Smallest and largest possible value.

    Returns:
        The interval; (NaN, NaN) for fewer than two values.
    """
    if len(values) < 2:
        return (np.nan, np.nan)
    value = float(values.mean())
    low, high = bounds
    unseen = wilson_interval(0, len(values))[1]
    return (value - unseen * (value - low), value + unseen * (high - value))


def _are_equal(values: Floats) -> bool:
    """Return True if all values are equal up to rounding."""
    return bool(np.ptp(values) <= 1e-9 * np.abs(values).max())


def _resampled_sums(values: Floats, count: int, seed: int) -> Floats:
    return np.concatenate([counts @ values for counts in resamples(len(values), count, seed)])


def percentile_interval(resampled: Floats) -> Interval:
    """Return the 2.5 % and 97.5 % quantiles of the values of a statistic in m resamples, (m,)."""
    low, high = np.quantile(resampled, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    return (float(low), float(high))


def resamples(size: int, count: int, seed: int) -> Iterator[Floats]:
    """Draw bootstrap resamples, each as the number of times that each value of the sample is drawn.

    Args:
        size: Number of values in the sample and in each resample.
        count: Number of resamples.
        seed: Seed of the random draws.

    Yields:
        Blocks of resamples: a row for each resample, with the count of each value of the sample, (…, size).
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
    """Draw all resamples at once and cache them, (count, size)."""
    counts = _draw_counts(np.random.default_rng(seed), size, count)
    counts.flags.writeable = False
    return counts


def _draw_counts(generator: np.random.Generator, size: int, count: int) -> Floats:
    """Draw resamples, and count the draws of each value of the sample in each resample, (count, size)."""
    indices = generator.integers(0, size, (count, size), dtype=np.int32) + size * np.arange(count)[:, None]
    return np.bincount(indices.ravel(), minlength=count * size).reshape(count, size).astype(np.float64)
