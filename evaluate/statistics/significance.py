"""Paired tests of a difference between two policies, and the correction of multiple tests."""

import itertools
from collections.abc import Sequence

import numpy as np

from evaluate.statistics.intervals import Bools, Floats

EXACT_PAIRS = 13
"""Largest number of pairs for which all 2^n sign flips are listed (8192)."""
FLIPS = 9_999
"""Number of random sign flips of a permutation test that is too large to list in full."""
MORE_FLIPS = 99_999
"""Number of random sign flips if fewer than MIN_EXCEEDANCES of the first reach the observed mean.

The smallest p-value of the first, 1/10000, times the comparisons of a full battery could never be significant.
"""
MIN_EXCEEDANCES = 10
"""Number of flips that reach the observed mean, without the observed one, below which MORE_FLIPS are drawn."""
BYTE_SIGNS = np.array(list(itertools.product((1.0, -1.0), repeat=8)))
"""Signs of eight pairs for every byte, (256, 8)."""


def mcnemar(a: Bools, b: Bools) -> float:
    """Compute the exact two-sided p-value of McNemar's test of the paired outcomes `a` and `b`."""
    from scipy.stats import binomtest

    only_a = int((a & ~b).sum())
    only_b = int((b & ~a).sum())
    if only_a + only_b == 0:
        return 1.0
    return float(binomtest(only_a, only_a + only_b).pvalue)


def sign_flip_test(differences: Floats, seed: int = 0) -> float:
    """Compute the two-sided permutation p-value of a mean paired difference.

    It is the proportion of sign flips with at least as large a mean. Up to EXACT_PAIRS pairs are flipped in every way.
    For more, flips are random, the observed one among them (Phipson and Smyth 2010): 9999, or 99 999 if almost none of
    the first reaches the observed mean. Both p-values are valid. A result that is significant after the second draw was
    so after the first. `scipy.stats.permutation_test(permutation_type="samples")` gives the same; sums of eight pairs
    by table are many times faster.

    Args:
        differences: Paired differences, (n,).
        seed: Seed of the random flips.

    Returns:
        The p-value.
    """
    # Summation order differs between flips: sums that are equal on paper must count as equal.
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
    """Count the random flips with a sum of at least the observed size; a random byte flips eight pairs."""
    padded = np.pad(differences, (0, -len(differences) % 8)).reshape(-1, 8)
    tables = padded @ BYTE_SIGNS.T  # (bytes, 256)
    byte_indices = np.arange(len(padded))
    count = 0
    for block in np.array_split(np.arange(flips), max(1, flips // 10_000)):
        random_bytes = generator.integers(0, 256, (len(block), len(padded)), dtype=np.uint8)
        count += int((np.abs(tables[byte_indices, random_bytes].sum(axis=1)) >= observed).sum())
    return count


def holm(p_values: Sequence[float], weights: Sequence[float] | None = None) -> list[float]:
    """Correct p-values for their number by Holm's method (Holm 1979), with weights.

    In ascending order, each p-value is multiplied by the sum of the remaining weights over its own weight. Without
    weights this is m − k + 1 for the k-th smallest of m. The probability of any false claim among them is then at most
    the level, for any dependence of the tests.

    Args:
        p_values: p-values of the tests.
        weights: Positive weight of each; None for equal weights.

    Returns:
        Corrected p-values, in the given order.
    """
    shares = np.ones(len(p_values)) if weights is None else np.asarray(weights, np.float64)
    weighted = np.asarray(p_values, np.float64) / shares
    order = np.argsort(weighted, kind="stable")
    left = np.cumsum(shares[order][::-1])[::-1]
    corrected = np.empty(len(order))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(left * weighted[order]))
    return [float(value) for value in corrected]
