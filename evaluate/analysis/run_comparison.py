"""Two runs of a policy against each other: episode by episode where they ran the same ones, else as two samples."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.analysis.comparison import FALL_RATE, METRICS, paired_difference
from evaluate.statistics.intervals import Bools, Floats, Interval, newcombe_interval, two_sample_interval
from evaluate.statistics.significance import fall_rates_test, relabelling_test


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
    values_a, values_b = ({FALL_RATE: each.fell.astype(np.float64)} | each.errors for each in (a, b))
    for metric in METRICS:
        if metric in values_a and metric in values_b:
            yield _compare(metric, values_a[metric], values_b[metric], paired=paired)


def _compare(metric: str, a: Floats, b: Floats, *, paired: bool) -> MetricDifference:
    mean_a, mean_b = float(a.mean()), float(b.mean())
    if paired:
        return MetricDifference(metric, mean_a, mean_b, *paired_difference(metric, b, a))
    if metric == FALL_RATE:
        found = newcombe_interval(a > 0, b > 0), fall_rates_test(a > 0, b > 0), "Barnard"
    else:
        found = two_sample_interval(a, b), relabelling_test(b, a), "permutation"
    return MetricDifference(metric, mean_a, mean_b, mean_b - mean_a, *found)
