"""Exact sizes of tests of counts: how often they claim a difference where there is none, by adding up all outcomes."""

from functools import cache

import numpy as np

from evaluate.analysis.comparison import SIGNIFICANT as SIGNIFICANT
from evaluate.statistics.significance import fall_rates_test, mcnemar


@cache
def attainable_mcnemar(pairs: int, discordant: float) -> float:
    """Exact chance that McNemar's test is significant without a difference, if pairs disagree with that probability."""
    from scipy.stats import binom

    size = 0.0
    for count in range(pairs + 1):
        splits = np.arange(count + 1)
        rejected = np.array([mcnemar_p_value(int(k), count) < SIGNIFICANT for k in splits])
        size += float(binom.pmf(count, pairs, discordant)) * float(binom.pmf(splits, count, 0.5) @ rejected)
    return size


@cache
def discordance(fall_probability: float) -> float:
    """Probability that just one of two equal policies falls, which share half of their luck."""
    from scipy.stats import multivariate_normal, norm

    quantile = float(norm.ppf(fall_probability))
    both = float(multivariate_normal(cov=[[1.0, 0.5], [0.5, 1.0]]).cdf([quantile, quantile]))
    return 2.0 * (fall_probability - both)


@cache
def mcnemar_p_value(only_a: int, discordant: int) -> float:
    """Exact McNemar p-value of so many pairs that disagree, in so many of which a alone fell."""
    pairs = np.arange(discordant) < only_a
    return mcnemar(pairs, ~pairs)


@cache
def barnard_p_value(count: int, fell_a: int, fell_b: int) -> float:
    """Barnard's p-value of so many falls among as many episodes of either."""
    return fall_rates_test(np.arange(count) < fell_a, np.arange(count) < fell_b)
