"""Paired significance tests of two policies, and Holm's correction for multiple tests."""

import itertools
from collections.abc import Sequence

import numpy as np

from evaluate.statistics.intervals import Bools, Floats

EXACT_PAIRS = 13
"""Largest number n of paired episodes for which the test enumerates all 2^n sign vectors (8192).

For more pairs, the test draws sign vectors at random.
"""
FLIPS = 9_999
"""Number of random sign vectors that the sign-flip test draws first for more than EXACT_PAIRS pairs."""
MORE_FLIPS = 99_999
"""Total number of random sign vectors of the sign-flip test if the first FLIPS give a small p-value.

The first FLIPS alone give no p-value below 1/10000. Holm's correction multiplies a p-value by the number of
comparisons. In a full benchmark run, this product would never be significant.
"""
MIN_EXCEEDANCES = 10
"""Number of sign vectors at least as extreme as the observation that the first FLIPS must contain.

A sign vector multiplies each paired difference by 1 or −1. It is at least as extreme if the absolute mean of the
products is at least the absolute mean of the differences. If fewer sign vectors are extreme, the sign-flip test draws
further sign vectors, up to MORE_FLIPS.
"""
BYTE_SIGNS = np.array(list(itertools.product((1.0, -1.0), repeat=8)))
"""Signs, 1 or −1, of eight paired differences, with one row for each value of a random byte, (256, 8)."""


def mcnemar(a: Bools, b: Bools) -> float:
    """Compute the exact two-sided p-value of McNemar's test: do two policies succeed equally often?

    Args:
        a: Outcome of the first policy in each episode, for example True for success, (n,).
        b: Outcome of the second policy in the same episodes, (n,).

    Returns:
        The p-value; 1 if the outcomes agree in every episode.
    """
    from scipy.stats import binomtest

    only_a = int((a & ~b).sum())
    only_b = int((b & ~a).sum())
    if only_a + only_b == 0:
        return 1.0
    return float(binomtest(only_a, only_a + only_b).pvalue)


def sign_flip_test(differences: Floats, seed: int = 0) -> float:
    """Compute the two-sided p-value of the mean of paired differences by a sign-flip permutation test.

    If two policies are equal, each difference is as likely positive as negative. A sign vector multiplies each
    difference by 1 or −1. The p-value is the proportion of sign vectors for which the absolute mean of the products is
    at least the absolute mean of the differences.

    The test enumerates all sign vectors for up to EXACT_PAIRS pairs. For more pairs it draws FLIPS random sign vectors,
    or MORE_FLIPS if fewer than MIN_EXCEEDANCES of them reach the observed absolute mean. The observed signs count as
    one further sign vector (Phipson and Smyth 2010). The p-value is valid after either draw. A result that is
    significant after the second draw is also significant after the first draw.

    `scipy.stats.permutation_test(permutation_type="samples")` gives the same p-value. This function is many times
    faster, because it adds the differences in groups of eight with a table of their sums.

    Args:
        differences: Difference between two policies in each episode, (n,).
        seed: Seed of the random sign vectors.

    Returns:
        The p-value, 0 … 1.
    """
    # A tolerance is subtracted, because equal sums in a different order of summation can differ by rounding errors.
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
    """Count the random sign vectors for which the absolute sum is at least as large as `observed`.

    A sign vector multiplies each difference by 1 or −1, and the products are added. One random byte gives the signs of
    eight differences.

    Args:
        differences: Paired differences, (n,).
        observed: Absolute value of the observed sum of the differences, minus a tolerance for rounding.
        flips: Number of random sign vectors to draw.
        generator: Random generator.

    Returns:
        Number of sign vectors, 0 … `flips`.
    """
    padded = np.pad(differences, (0, -len(differences) % 8)).reshape(-1, 8)
    # The sum of eight signed differences for each group of eight and each value of a random byte, (bytes, 256).
    tables = padded @ BYTE_SIGNS.T
    byte_indices = np.arange(len(padded))
    count = 0
    for block in np.array_split(np.arange(flips), max(1, flips // 10_000)):
        random_bytes = generator.integers(0, 256, (len(block), len(padded)), dtype=np.uint8)
        count += int((np.abs(tables[byte_indices, random_bytes].sum(axis=1)) >= observed).sum())
    return count


def holm(p_values: Sequence[float], weights: Sequence[float] | None = None) -> list[float]:
    """Correct p-values for the number of tests by Holm's method with weights (Holm 1979).

    The tests are sorted by the quotient p-value / weight. Each p-value is multiplied by the sum of the weights from
    this test to the last one, divided by its own weight. With equal weights, this factor is m − k + 1 for the k-th
    smallest of m p-values.

    A test is significant if its corrected p-value is below a significance level. The probability of any false positive
    is then at most this level, for any dependence between the tests.

    Args:
        p_values: Uncorrected p-value of each of m tests, (m,).
        weights: Positive weight of each test, (m,); None for equal weights.

    Returns:
        Corrected p-value of each test, at most 1, in the order of `p_values`.
    """
    shares = np.ones(len(p_values)) if weights is None else np.asarray(weights, np.float64)
    weighted = np.asarray(p_values, np.float64) / shares
    order = np.argsort(weighted, kind="stable")
    left = np.cumsum(shares[order][::-1])[::-1]
    corrected = np.empty(len(order))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(left * weighted[order]))
    return [float(value) for value in corrected]
