"""Intervals and paired tests: Wilson, bootstrap of a mean, exact McNemar, sign-flip permutation of a mean difference.

All are seeded, so that the same episodes always give the same report.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Interval = tuple[float, float]

CONFIDENCE = 0.95
RESAMPLES = 9999
"""Of a bootstrap, and of a permutation test too large to list in full: the smallest p-value is then 1/10000."""
BATCH_VALUES = 2_000_000
"""Values drawn at once by the bootstrap, which bounds its memory."""
EXACT_PAIRS = 13
"""Up to so many pairs all 2^n sign flips are listed (8192)."""


def wilson_interval(successes: int, trials: int) -> Interval:
    """Wilson score interval of a share, 95 %; (NaN, NaN) without trials."""
    from scipy.stats import binomtest

    if trials == 0:
        return (np.nan, np.nan)
    interval = binomtest(successes, trials).proportion_ci(CONFIDENCE, method="wilson")
    return (float(interval.low), float(interval.high))


def bootstrap_interval(values: Floats, seed: int = 0) -> Interval:
    """Bootstrap interval of the mean, 95 %, bias-corrected and accelerated; (NaN, NaN) for fewer than two values.

    Values that are all the same, but for rounding, leave nothing to resample: the interval is then that value.
    """
    from scipy.stats import bootstrap

    if len(values) < 2:
        return (np.nan, np.nan)
    if np.ptp(values) <= 1e-9 * np.abs(values).max():
        return (float(values.min()), float(values.max()))
    generator = np.random.default_rng(seed)
    interval = bootstrap(
        (values,),
        np.mean,
        n_resamples=RESAMPLES,
        batch=max(1, BATCH_VALUES // len(values)),
        confidence_level=CONFIDENCE,
        method="BCa",
        rng=generator,
    ).confidence_interval
    return (float(interval.low), float(interval.high))


def mcnemar(a: Bools, b: Bools) -> float:
    """Exact McNemar p-value, two-sided, of two paired yes/no outcomes: binomial test on the pairs that disagree."""
    from scipy.stats import binomtest

    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    if only_a + only_b == 0:
        return 1.0
    return float(binomtest(only_a, only_a + only_b).pvalue)


def sign_flip_test(differences: Floats, seed: int = 0) -> float:
    """Permutation p-value, two-sided, of a mean paired difference: share of sign flips with at least as large a mean.

    Few pairs are flipped in every way. For more, random flips, the observed one among them (Phipson and Smyth 2010).
    `scipy.stats.permutation_test(permutation_type="samples")` gives the same; one matrix product is many times faster.
    """
    # Summation order differs between flips: sums that are equal on paper must count as equal.
    observed = np.abs(differences.sum()) * (1.0 - 1e-12)
    pairs = len(differences)
    if pairs <= EXACT_PAIRS:
        signs = np.array(list(itertools.product((1.0, -1.0), repeat=pairs)))
        return float((np.abs(signs @ differences) >= observed).mean())
    generator = np.random.default_rng(seed)
    as_large = 1
    for block in np.array_split(np.arange(RESAMPLES), 10):
        signs = 1.0 - 2.0 * generator.integers(0, 2, (len(block), pairs), dtype=np.int8)
        as_large += int((np.abs(signs @ differences) >= observed).sum())
    return as_large / (RESAMPLES + 1)
