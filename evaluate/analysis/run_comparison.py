"""Two runs of a policy against each other: episode by episode where they ran the same ones, else as two samples."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.analysis.comparison import ERRORS, FALL_RATE
from evaluate.statistics.intervals import (
    Bools,
    Floats,
    Interval,
    difference_interval,
    newcombe_interval,
    share_difference_interval,
    two_sample_interval,
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
        interval, p_value, test = difference_interval(b - a), sign_flip_test(b - a), "paired sign-flip permutation"
        return MetricDifference(metric, *means, float((b - a).mean()), interval, p_value, test)
    p_value = relabelling_test(b, a)
    return MetricDifference(metric, *means, means[1] - means[0], two_sample_interval(a, b), p_value, "permutation")


def _paired_shares(a: Bools, b: Bools) -> Interval:
    return share_difference_interval(int((b & ~a).sum()), int((a & ~b).sum()), len(a))
