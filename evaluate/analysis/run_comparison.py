"""Two runs of a policy against each other: episode by episode where they ran the same ones, else as two samples."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.analysis.comparison import ERRORS, FALL_RATE
from evaluate.statistics.intervals import (
    FEWER_RESAMPLES,
    Bools,
    Floats,
    Interval,
    bootstrap_interval,
    percentile_interval,
    resamples,
    share_difference_interval,
    wilson_interval,
)
from evaluate.statistics.significance import fall_rates_test, mcnemar, relabelling_test, sign_flip_test


@dataclass(frozen=True)
class Sample:
    """Episodes of one policy on one scenario in one run."""

    seeds: NDArray[np.int64]
    fell: Bools
    errors: dict[str, Floats]
    """Name -> of each episode; those of ERRORS that the run has."""


@dataclass(frozen=True)
class MetricDifference:
    """One metric of b minus that of a; below zero b is better. The fields are keys of the JSON file."""

    metric: str
    a: float
    b: float
    difference: float
    ci: Interval
    """95 %"""
    p_value: float
    test: str


def compare_samples(a: Sample, b: Sample, *, paired: bool) -> Iterator[MetricDifference]:
    """Falls, and every error that both have."""
    shares = float(a.fell.mean()), float(b.fell.mean())
    interval = _paired_shares(a.fell, b.fell) if paired else newcombe_interval(a.fell, b.fell)
    test, p_value = ("exact McNemar", mcnemar) if paired else ("Barnard", fall_rates_test)
    yield MetricDifference(FALL_RATE, *shares, shares[1] - shares[0], interval, p_value(a.fell, b.fell), test)
    for metric in ERRORS:
        if metric in a.errors and metric in b.errors:
            yield _of_means(metric, a.errors[metric], b.errors[metric], paired=paired)


def _of_means(metric: str, a: Floats, b: Floats, *, paired: bool) -> MetricDifference:
    means = float(a.mean()), float(b.mean())
    if paired:
        interval, p_value, test = bootstrap_interval(b - a), sign_flip_test(b - a), "paired sign-flip permutation"
        return MetricDifference(metric, *means, float((b - a).mean()), interval, p_value, test)
    p_value = relabelling_test(b, a)
    return MetricDifference(metric, *means, means[1] - means[0], two_sample_interval(a, b), p_value, "permutation")


def _paired_shares(a: Bools, b: Bools) -> Interval:
    return share_difference_interval(int((b & ~a).sum()), int((a & ~b).sum()), len(a))


def newcombe_interval(a: Bools, b: Bools) -> Interval:
    """Interval of the difference of two shares that are not paired, b − a, from the Wilson intervals of both.

    Newcombe 1998, Statistics in Medicine 17, 873, method 10.
    """
    (low_a, high_a), (low_b, high_b) = (wilson_interval(int(x.sum()), len(x)) for x in (a, b))
    share_a, share_b = a.mean(), b.mean()
    below = float(np.hypot(share_b - low_b, high_a - share_a))
    above = float(np.hypot(high_b - share_b, share_a - low_a))
    return (float(share_b - share_a) - below, float(share_b - share_a) + above)


def two_sample_interval(a: Floats, b: Floats) -> Interval:
    """Percentile bootstrap of mean(b) − mean(a), each resampled by itself; (NaN, NaN) for fewer than two values."""
    if min(len(a), len(b)) < 2:
        return (np.nan, np.nan)
    return percentile_interval(_resampled_means(b, 0) - _resampled_means(a, 1))


def _resampled_means(values: Floats, seed: int) -> Floats:
    blocks = resamples(len(values), FEWER_RESAMPLES, seed)
    return np.concatenate([counts @ values for counts in blocks]) / len(values)
