"""Paired tests of the difference between two policies, and the correction for multiple tests."""

import itertools
from collections.abc import Sequence

import numpy as np

from evaluate.statistics.intervals import Bools, Floats

EXACT_PAIRS = 13
"""Largest number n of pairs for which the test enumerates all 2^n sign flips (8192 flips)."""
FLIPS = 9_999
"""Number of random sign flips for more than EXACT_PAIRS pairs."""
MORE_FLIPS = 99_999
"""Total number of sign flips if fewer than MIN_EXCEEDANCES of the first FLIPS reach the observed mean.

FLIPS alone give no p-value below 1/10000. Times the number of comparisons of a full benchmark run, this p-value could
never be significant.
"""
MIN_EXCEEDANCES = 10
"""Number of random flips that must reach the observed mean; with fewer, the test draws MORE_FLIPS."""
BYTE_SIGNS = np.array(list(itertools.product((1.0, -1.0), repeat=8)))
"""Signs of eight pairs, ±1, in a row for each value of a random byte, (256, 8)."""


def mcnemar(a: Bools, b: Bools) -> float:
    """Compute the exact two-sided p-value of McNemar's test for paired outcomes `a` and `b`, (n,) each."""
    from scipy.stats import binomtest

    only_a = int((a & ~b).sum())
    only_b = int((b & ~a).sum())
    if only_a + only_b == 0:
        return 1.0
    return float(binomtest(only_a, only_a + only_b).pvalue)


def sign_flip_test(differences: Floats, seed: int = 0) -> float:
    """Compute the two-sided permutation p-value of a mean paired difference.

    The p-value is the proportion of sign flips with a mean of at least the observed size. The test enumerates all sign
    flips of up to EXACT_PAIRS pairs. For more pairs it draws FLIPS random sign flips, or MORE_FLIPS if almost none of
    the first reaches the observed mean. The observed signs count as one further flip (Phipson and Smyth 2010). The
    p-value is valid after either draw. A result that is significant after the second draw was so after the first.
    `scipy.stats.permutation_test(permutation_type="samples")` gives the same p-value. The table of sums of eight pairs
    makes this function many times faster.

    Args:
        differences: Paired differences, (n,).
        seed: Seed of the random flips.

    Returns:
        The p-value.
    """
    # The tolerance is needed because the order of summation differs between flips: equal sums may differ by rounding.
    observed = np.abs(differences.sum()) - 1e-12 * np.abs(differences).sum()
    if len(differences) <= EXACT_PAIRS:
        signs = np.array(list(itertools.product((1.0, -1.0), repeat=len(differences))))
        return float((np.abs(signs @ differences) >= observed).mean())
    generator = np.random.default_rng(seed)
    as_large = _flips_as_large(differences, observed, FLIPS, generator)
    if as_large >= MIN_EXCEEDANCES:
        return (as_large + 1) / (FLIPS + 1)
    as_large += _flips_as_large(differences, observed, MORE_FLIPS - FLIPS, generator)
    return (as_large + 1) / (MORE_FLIPS + 1)


def _flips_as_large(differences: Floats, observed: float, flips: int, generator: np.random.Generator) -> int:
    """Count random sign flips with a sum of at least the observed size; a byte flips eight pairs."""
    padded = np.pad(differences, (0, -len(differences) % 8)).reshape(-1, 8)
    tables = padded @ BYTE_SIGNS.T  # sum of eight signed differences for each value of a byte, (bytes, 256)
    byte_indices = np.arange(len(padded))
    count = 0
    for block in np.array_split(np.arange(flips), max(1, flips // 10_000)):
        random_bytes = generator.integers(0, 256, (len(block), len(padded)), dtype=np.uint8)
        count += int((np.abs(tables[byte_indices, random_bytes].sum(axis=1)) >= observed).sum())
    return count


def holm(p_values: Sequence[float], weights: Sequence[float] | None = None) -> list[float]:
    """Correct p-values for the number of tests by Holm's method with weights (Holm 1979).

    The p-values are sorted by p-value over weight. Each is multiplied by the sum of the remaining weights over its own
    weight. With equal weights, this factor is m − k + 1 for the k-th smallest of m p-values. If the corrected p-values
    are compared with a level, the probability of any false claim is at most this level. This holds for any dependence
    between the tests.

    Args:
        p_values: p-values of the tests.
        weights: Positive weight of each test; None for equal weights.

    Returns:
        Corrected p-values, in the order of `p_values`.
    """
    shares = np.ones(len(p_values)) if weights is None else np.asarray(weights, np.float64)
    weighted = np.asarray(p_values, np.float64) / shares
    order = np.argsort(weighted, kind="stable")
    left = np.cumsum(shares[order][::-1])[::-1]
    corrected = np.empty(len(order))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(left * weighted[order]))
    return [float(value) for value in corrected]
