"""95 % intervals of policies that one algorithm has trained with several seeds, over seeds and episodes.

Every trained policy (training seed) runs the same episodes. A result is therefore a table with one row for each
training seed and one column for each episode. Both vary: another training seed gives another policy, and another
episode gives other commands and disturbances. An interval that ignores the training seeds is too narrow.
"""

from collections.abc import Iterator

import numpy as np

from evaluate.statistics.intervals import (
    RESAMPLES,
    UNBOUNDED,
    Floats,
    Interval,
    identical_values_interval,
    resamples,
    student_bootstrap_tail,
    student_trials_factor,
    wilson_interval,
)

MIN_SEEDS = 2
"""Smallest number of training seeds that give an estimate of the variation between seeds."""
MIN_BOOTSTRAP_SEEDS = 3
"""Smallest number of training seeds for a bootstrap; resamples of two seeds never exceed the range of the seeds."""
TRIMMED = 0.25
"""Proportion of the values that the interquartile mean leaves out at each end."""
_EPISODE_STREAM = 0
"""Seed of the random draws of episodes in a bootstrap."""
_TRAINING_SEED_STREAM = 1
"""Seed of the random draws of training seeds in a bootstrap; other than the seed of the draws of episodes."""


def interquartile_mean(values: Floats) -> Floats:
    """Compute the interquartile mean over the last axis: the mean of the middle half of the values.

    The function leaves out the lowest and the highest quarter, each rounded down to whole values, as
    `scipy.stats.trim_mean` does in rliable (Agarwal et al. 2021, NeurIPS).

    Args:
        values: Values, (…, k).

    Returns:
        Interquartile mean, (…).
    """
    count = values.shape[-1]
    cut = int(TRIMMED * count)
    return np.asarray(np.sort(values, axis=-1)[..., cut : count - cut].mean(axis=-1))


def rate_interval(success: Floats) -> Interval:
    """Compute the 95 % interval of a success rate on one scenario over training seeds and episodes.

    The interval is Wilson's for an effective number of trials, with the quantile of Student's t for the number of
    training seeds (see `intervals.mean_proportion_interval`). The variance of the rate is estimated with clusters in
    two directions (Cameron, Gelbach and Miller 2011, Journal of Business and Economic Statistics 29): variance of the
    means of the seeds, plus variance of the means of the episodes, minus the variance of the remaining noise, which
    both contain.

    Args:
        success: Success, 0 … 1, of s training seeds in n episodes, (s, n).

    Returns:
        The interval; (NaN, NaN) for fewer than MIN_SEEDS training seeds or without episodes.
    """
    seeds, episodes = success.shape
    if seeds < MIN_SEEDS or not episodes:
        return (np.nan, np.nan)
    mean = float(success.mean())
    variance = _variance_of_mean(success)
    if variance <= 0.0:
        return wilson_interval(mean * seeds, seeds)
    trials = min(mean * (1.0 - mean) / variance, seeds * episodes)
    trials *= student_trials_factor(seeds)
    return wilson_interval(mean * trials, trials)


def mean_interval(values: Floats, bounds: Interval = UNBOUNDED) -> Interval:
    """Compute the 95 % bootstrap interval of a mean over training seeds and episodes.

    Args:
        values: Values of s training seeds in n episodes, (s, n), for example the score for each episode seed.
        bounds: Smallest and largest possible value.

    Returns:
        The interval, in the unit of the values; (NaN, NaN) for fewer than MIN_BOOTSTRAP_SEEDS training seeds.
    """
    if len(values) < MIN_BOOTSTRAP_SEEDS:
        return (np.nan, np.nan)
    return _bootstrap(values[:, :, None], bounds, is_interquartile=False)


def interquartile_mean_interval(values: Floats, bounds: Interval = UNBOUNDED) -> Interval:
    """Compute the 95 % stratified bootstrap interval of an interquartile mean over training seeds and scenarios.

    Args:
        values: Values of s training seeds in n episodes on k scenarios, (s, n, k). One policy, s = 1, has an interval
            over episodes alone.
        bounds: Smallest and largest possible value.

    Returns:
        The interval, in the unit of the values; (NaN, NaN) for two training seeds, or one policy with one episode.
    """
    return _bootstrap(values, bounds, is_interquartile=True)


def _bootstrap(values: Floats, bounds: Interval, *, is_interquartile: bool) -> Interval:
    """Compute a 95 % bootstrap interval over training seeds and episodes, with scenarios as strata.

    The scenarios are fixed, as in the stratified bootstrap of rliable. A resample draws training seeds and episodes
    with replacement. It draws them once for all scenarios, because each network and each episode seed occurs on all of
    them; rliable draws the runs of each task on their own. The ends are percentiles for Student's t instead of the
    normal distribution, and for a variance with s − 1 in the denominator (see `intervals.difference_interval`), because
    plain percentiles of few training seeds contain the true value too rarely.

    Args:
        values: Values of s training seeds in n episodes on k scenarios, (s, n, k).
        bounds: Smallest and largest possible value.
        is_interquartile: True for the interquartile mean over seeds and scenarios, False for the mean.

    Returns:
        The interval, in the unit of the values; (NaN, NaN) for two training seeds, for one policy with one episode, or
        if a value is NaN.
    """
    unit_axis = 1 if len(values) == 1 else 0
    units = values.shape[unit_axis]
    if units < 2 or len(values) == 2 or not values.size or np.isnan(values).any():
        return (np.nan, np.nan)
    if np.ptp(values) == 0.0:
        return identical_values_interval(values.mean(axis=(1 - unit_axis, 2)), bounds)
    statistics = np.concatenate([*_resampled_statistics(values, is_interquartile)])
    tail = student_bootstrap_tail(units)
    low, high = np.quantile(statistics, [tail, 1.0 - tail])
    return (float(low), float(high))


def _resampled_statistics(values: Floats, is_interquartile: bool) -> Iterator[Floats]:
    """Compute the mean or the interquartile mean in each resample of training seeds and episodes.

    Args:
        values: Values of s training seeds in n episodes on k scenarios, (s, n, k).
        is_interquartile: True for the interquartile mean over seeds and scenarios, False for the mean.

    Yields:
        Statistic of each resample of a block, (rows,).
    """
    seeds, episodes, scenarios = values.shape
    by_episode = values.transpose(1, 0, 2).reshape(episodes, seeds * scenarios)
    seed_counts = np.concatenate([*resamples(seeds, RESAMPLES, _TRAINING_SEED_STREAM)])
    first = 0
    for episode_counts in resamples(episodes, RESAMPLES, _EPISODE_STREAM):
        rows = len(episode_counts)
        means = (episode_counts @ by_episode / episodes).reshape(rows, seeds, scenarios)
        counts = seed_counts[first : first + rows]
        first += rows
        if is_interquartile:
            drawn = np.repeat(np.tile(np.arange(seeds), rows), counts.ravel().astype(np.int64)).reshape(rows, seeds)
            means = np.take_along_axis(means, drawn[:, :, None], axis=1)
            yield interquartile_mean(means.reshape(rows, seeds * scenarios))
        else:
            yield (counts * means.mean(axis=2)).sum(axis=1) / seeds


def _variance_of_mean(values: Floats) -> float:
    """Estimate the variance of the mean of a table of training seeds and episodes, clustered in both directions.

    Args:
        values: Values of s training seeds in n episodes, (s, n).

    Returns:
        The variance, at least as large as the variance for clusters in one direction.
    """
    seeds, episodes = values.shape
    seed_means = values.mean(axis=1, keepdims=True)
    episode_means = values.mean(axis=0, keepdims=True)
    by_seed = float(seed_means.var(ddof=1) / seeds)
    if episodes == 1:
        return by_seed
    by_episode = float(episode_means.var(ddof=1)) / episodes
    noise = values - seed_means - episode_means + values.mean()
    both = float((noise**2).sum()) / ((seeds - 1) * (episodes - 1) * seeds * episodes)
    return float(max(by_seed + by_episode - both, by_seed, by_episode))
