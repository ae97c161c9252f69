"""Interquartile mean, as rliable defines it (Agarwal et al. 2021, NeurIPS), and improvement by episode.

rliable's intervals are percentile bootstraps over training runs; ours are over episodes.
"""

import numpy as np

from evaluate.statistics.intervals import (
    FEWER_RESAMPLES,
    UNBOUNDED,
    Floats,
    Interval,
    agreeing_interval,
    percentile_interval,
    resamples,
    share_difference_interval,
)

TRIMMED = 0.25
"""Share of the values cut off at either end."""


def interquartile_mean(values: Floats) -> float:
    """Mean of the middle half of the values; NaN without any."""
    from scipy.stats import trim_mean

    return float(trim_mean(values, TRIMMED)) if len(values) else float("nan")


def interquartile_mean_interval(values: Floats, bounds: Interval = UNBOUNDED, seed: int = 0) -> Interval:
    """Percentile bootstrap interval of the interquartile mean, 95 %; (NaN, NaN) for fewer than two values.

    `bounds` of a value, for values that all agree: see `agreeing_interval`.
    """
    if len(values) < 2 or np.ptp(values) == 0.0:
        return agreeing_interval(values, bounds, TRIMMED)
    blocks = resamples(len(values), FEWER_RESAMPLES, seed)
    return percentile_interval(np.concatenate([_trimmed_means(counts, values) for counts in blocks]))


def _trimmed_means(counts: Floats, values: Floats) -> Floats:
    """Interquartile means of resamples in which value j is drawn counts[:, j] times."""
    order = np.argsort(values)
    low = int(TRIMMED * len(values))
    high = len(values) - low
    reached = np.cumsum(counts[:, order], axis=1).clip(low, high)
    within = np.diff(reached, axis=1, prepend=float(low))
    return np.asarray(within @ values[order] / (high - low))


def improvement_by_episode(a: Floats, b: Floats) -> tuple[float, Interval]:
    """Probability that a's value is larger than b's in the same episode, ties counted as half; with its interval.

    Wins and losses are two paired shares, so that the interval is the score interval of their difference. Equal to
    rliable's figure only if the policies' episodes have nothing in common: chance in a shared episode cancels here.
    """
    wins, losses = int((a > b).sum()), int((a < b).sum())
    if not len(a):
        return (np.nan, (np.nan, np.nan))
    low, high = share_difference_interval(wins, losses, len(a))
    return ((1.0 + (wins - losses) / len(a)) / 2.0, ((1.0 + low) / 2.0, (1.0 + high) / 2.0))
