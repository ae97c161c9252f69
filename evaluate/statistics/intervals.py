"""Intervals of shares and means, and the resampling behind every bootstrap; all 95 %.

Everything is seeded, so that the same episodes always give the same report.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Interval = tuple[float, float]

CONFIDENCE = 0.95
UNBOUNDED = (-np.inf, np.inf)
"""Bounds of values that may be anything."""
RESAMPLES = 9999
"""Resamples of a bootstrap of a mean."""
MAX_CACHED_VALUES = 12_000_000
"""Resamples of at most so many values in all (96 MB) are drawn once and kept for the next of that size."""
BLOCK_VALUES = 500_000
"""Others are drawn again each time, so many values at once, which bounds the memory."""


def wilson_interval(successes: float, trials: float) -> Interval:
    """Wilson score interval of a share; (NaN, NaN) without trials."""
    from scipy.special import ndtri

    if trials == 0:
        return (np.nan, np.nan)
    share, weight = successes / trials, float(ndtri(0.5 + CONFIDENCE / 2)) ** 2 / trials
    middle, reach = share + weight / 2, np.sqrt(weight * (share * (1.0 - share) + weight / 4))
    return (float(max(0.0, (middle - reach) / (1.0 + weight))), float(min(1.0, (middle + reach) / (1.0 + weight))))


def mean_proportion_interval(shares: Floats) -> Interval:
    """Interval of the mean of shares within 0 … 1, of which chance draws each by itself; (NaN, NaN) without any.

    Wilson's, of as many yes-or-no trials as have a mean that varies as much, with Student's t for the normal
    distribution: how surveys take shares in clusters (Korn and Graubard 1998, Survey Methodology 24; with Wilson's
    interval Dean and Pagano 2015, Journal of Survey Statistics and Methodology 3). Shares that all agree show nothing
    of how they vary: each then counts as one trial.
    """
    from scipy.special import ndtri, stdtrit

    count = len(shares)
    if count == 0:
        return (np.nan, np.nan)
    mean, trials, upper = float(shares.mean()), float(count), 0.5 + CONFIDENCE / 2
    if not _agree(shares):
        trials = mean * (1.0 - mean) * count / float(shares.var(ddof=1))
        trials *= float(ndtri(upper) / stdtrit(count - 1, upper)) ** 2
    return wilson_interval(mean * trials, trials)


def share_difference_interval(only_a: int, only_b: int, pairs: int) -> Interval:
    """Score interval of the difference of two paired shares, a − b (Tango 1998, Statistics in Medicine 17).

    `only_a` and `only_b` of the pairs disagree. It inverts the score form of McNemar's test as Wilson's inverts that of
    one share: without any disagreement it still has a width, where a bootstrap would claim certainty.
    """
    from scipy.optimize import brentq
    from scipy.special import ndtri

    if pairs == 0:
        return (np.nan, np.nan)
    difference, quantile = (only_a - only_b) / pairs, float(ndtri(0.5 + CONFIDENCE / 2))

    def excess(hypothesis: float, sign: float) -> float:
        return _score(only_a, only_b, pairs, hypothesis) - sign * quantile

    low = brentq(excess, -1.0, difference, args=(1.0,)) if difference > -1.0 else -1.0
    high = brentq(excess, difference, 1.0, args=(-1.0,)) if difference < 1.0 else 1.0
    return (float(low), float(high))


def _score(only_a: int, only_b: int, pairs: int, difference: float) -> float:
    """Distance of the data from a hypothetical difference of the shares, in its standard deviations.

    The share of `only_b`, under the hypothesis, is the root of 2n q² + B q − b δ(1 − δ) = 0 (Tango's equation 14).
    """
    if abs(difference) == 1.0:  # a difference that allows for no other data
        return float(np.copysign(np.inf, -difference))
    linear = -only_a - only_b + (2 * pairs - only_a + only_b) * difference
    constant = -only_b * difference * (1.0 - difference)
    share = (np.sqrt(linear**2 - 8 * pairs * constant) - linear) / (4 * pairs)
    variance = pairs * (2.0 * share + difference * (1.0 - difference))
    distance = only_a - only_b - pairs * difference
    if distance == 0.0:
        return 0.0
    return float(distance / np.sqrt(variance)) if variance > 0.0 else float(np.copysign(np.inf, distance))


def bootstrap_interval(values: Floats, bounds: Interval = UNBOUNDED, seed: int = 0) -> Interval:
    """Bootstrap interval of the mean, bias-corrected and accelerated; (NaN, NaN) for fewer than two values.

    Corrected, since falls skew the errors of episodes. Values that all agree leave nothing to resample: see
    `agreeing_interval`, which takes the `bounds` of a value. `scipy.stats.bootstrap(method="BCa")` gives the same;
    resamples that are kept are four times faster.
    """
    from scipy.special import ndtr, ndtri

    if len(values) < 2 or _agree(values):
        return identical_values_interval(values, bounds)
    if np.isnan(values).any():
        return (np.nan, np.nan)
    sums = _resampled_sums(values, RESAMPLES, seed)
    below, not_above = (sums < values.sum()).mean(), (sums <= values.sum()).mean()
    bias = ndtri((below + not_above) / 2)
    deviation = values - values.mean()
    acceleration = (deviation**3).sum() / (6.0 * (deviation**2).sum() ** 1.5)
    tails = bias + ndtri([0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    low, high = np.quantile(sums, ndtr(bias + tails / (1.0 - acceleration * tails))) / len(values)
    return (float(low), float(high))


def difference_interval(differences: Floats, bounds: Interval = UNBOUNDED, seed: int = 0) -> Interval:
    """Bootstrap interval of the mean of paired differences; (NaN, NaN) for fewer than two pairs; `bounds` as above.

    Percentiles, moved outwards as far as Student's t lies outside the normal distribution and n outside n − 1
    (Hesterberg 2015, The American Statistician 69). Not BCa, which estimates a skewness from the few episodes in which
    one policy fell and covers 90 % instead of 95 % (`python -m research calibration`).
    """
    from scipy.special import ndtr, stdtrit

    if len(differences) < 2 or _agree(differences):
        return identical_values_interval(differences, bounds)
    pairs = len(differences)
    tail = ndtr(-np.sqrt(pairs / (pairs - 1)) * stdtrit(pairs - 1, 0.5 + CONFIDENCE / 2))
    low, high = np.quantile(_resampled_sums(differences, RESAMPLES, seed), [tail, 1.0 - tail]) / pairs
    return (float(low), float(high))


def identical_values_interval(values: Floats, bounds: Interval) -> Interval:
    """Interval of the mean of n values that all agree; (NaN, NaN) for fewer than two.

    Others than those seen have at most the share that Wilson's interval has for none of n, 14 % of 24, and may be
    anything within the bounds (after Hanley and Lippman-Hand 1983, JAMA 249).
    """
    if len(values) < 2:
        return (np.nan, np.nan)
    value, (low, high) = float(values.mean()), bounds
    unseen = wilson_interval(0, len(values))[1]
    return (value - unseen * (value - low), value + unseen * (high - value))


def _agree(values: Floats) -> bool:
    """Whether values are all the same, but for rounding."""
    return bool(np.ptp(values) <= 1e-9 * np.abs(values).max())


def _resampled_sums(values: Floats, count: int, seed: int) -> Floats:
    return np.concatenate([counts @ values for counts in resamples(len(values), count, seed)])


def percentile_interval(resampled: Floats) -> Interval:
    """The middle 95 % of a statistic's resamples, (m,)."""
    low, high = np.quantile(resampled, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    return (float(low), float(high))


def resamples(size: int, count: int, seed: int) -> Iterator[Floats]:
    """How often each of `size` values is drawn in each of `count` resamples, as blocks of rows (…, size)."""
    if size * count <= MAX_CACHED_VALUES:
        yield _kept(size, count, seed)
        return
    generator = np.random.default_rng(seed)
    rows = max(1, BLOCK_VALUES // size)
    for first in range(0, count, rows):
        yield _draw(generator, size, min(rows, count - first))


@lru_cache(maxsize=4)
def _kept(size: int, count: int, seed: int) -> Floats:
    counts = _draw(np.random.default_rng(seed), size, count)
    counts.flags.writeable = False
    return counts


def _draw(generator: np.random.Generator, size: int, count: int) -> Floats:
    drawn = generator.integers(0, size, (count, size), dtype=np.int32) + size * np.arange(count)[:, None]
    return np.bincount(drawn.ravel(), minlength=count * size).reshape(count, size).astype(np.float64)
