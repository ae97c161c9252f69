"""Checks of intervals and tests on synthetic data sets, with the expected rate of positive results."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.statistics.breaking_point import breaking_point
from evaluate.statistics.intervals import (
    Interval,
    bootstrap_interval,
    difference_interval,
    paired_proportion_interval,
    wilson_interval,
)
from evaluate.statistics.significance import mcnemar, sign_flip_test
from research.statistics.synthetic import FallCurve, SyntheticAxis, SyntheticEpisodes, make_episodes, mean_error

COVERAGE_BOUNDS = (0.93, 0.97)
"""Bounds of the proportion of 95 % intervals that hold the truth."""
TYPE_I_ERROR_BOUNDS = (0.04, 0.06)
"""Bounds of the proportion of significant tests without a difference."""
DISCRETE_TEST_BOUNDS = (0.0, 0.06)
"""Bounds of the proportion of significant tests of counts. Their p-value can jump past 5 %; exact tests stay
below it."""
FALL_RATIO = 0.8
"""Ratio of the fall probabilities of the second and the first policy."""
MIN_COVERAGE_BOUNDS = (0.93, 1.0)
"""Bounds of the proportion of 95 % intervals that may hold the truth more often."""
PUSHES = (20.0, 35.0, 50.0, 65.0, 80.0, 100.0)
"""Severities of an axis of pushes, N·s."""
HALF = (FallCurve(0.495, 25.0, 20.0), FallCurve(0.01, 49.5, 90.0), FallCurve(0.495, 60.0, 60.0))
"""Curves with exactly one half at a level."""
STRETCH = (FallCurve(0.45, 30.0, 12.0), FallCurve(0.55, 75.0, 12.0))
"""Curves with a flat stretch below one half."""
AXES = {
    "": SyntheticAxis(PUSHES, (FallCurve(1.0, 55.0, 4.0),)),
    ", a sixth falls anyway": SyntheticAxis(PUSHES, (FallCurve(1 / 6, 0.0), FallCurve(5 / 6, 55.0, 6.0))),
    ", less is harder": SyntheticAxis((1.0, 0.7, 0.5, 0.35, 0.25), (FallCurve(1.0, 0.45, 5.0),)),
    ", one half at a level": SyntheticAxis((20.0, 50.0, 65.0, 140.0), HALF),
    ", flat below one half": SyntheticAxis(PUSHES, STRETCH),
    ", flat below one half, three levels": SyntheticAxis((35.0, 65.0, 100.0), STRETCH),
    ", an edge": SyntheticAxis(PUSHES, (FallCurve(0.1, 0.0), FallCurve(0.8, 57.0, 100.0), FallCurve(0.1, np.inf))),
    ", two fifths never fall": SyntheticAxis(PUSHES, (FallCurve(0.6, 45.0, 6.0), FallCurve(0.4, np.inf))),
}
"""Suffix of a check -> axis: logistic curves, and shapes that no model has."""

CheckFunction = Callable[[np.random.Generator], bool]
"""Returns the result of an interval or test on one data set."""


@dataclass(frozen=True)
class CalibrationCheck:
    """An interval or test that is repeated on many data sets."""

    name: str
    """Name of the row."""
    count: int
    """Number of episodes of a data set."""
    fall_probability: float
    """Fall probability of the first policy; NaN if it has none."""
    outcome: CheckFunction
    """Result for one data set."""
    bounds: Interval
    """Bounds of the rate of positive results."""
    expected: float = 0.95
    """Expected rate of positive results; NaN if unknown."""


def coverage_checks(count: int, fall_probability: float) -> Iterator[CalibrationCheck]:
    """Yield the checks of coverage, for `count` episodes at a `fall_probability`."""
    rules: dict[str, CheckFunction] = {
        "Wilson, falls": partial(_fall_rate, count, fall_probability),
        "BCa bootstrap, mean error": partial(_mean, count, fall_probability),
        "score, paired difference of falls": partial(_fall_difference, count, fall_probability),
        "bootstrap, paired difference of errors": partial(_mean_difference, count, fall_probability),
    }
    for name, outcome in rules.items():
        yield CalibrationCheck(name, count, fall_probability, outcome, COVERAGE_BOUNDS)


def breaking_checks(count: int) -> Iterator[CalibrationCheck]:
    """Yield the checks of the coverage of breaking points, for that number of episodes."""
    for name, axis in AXES.items():
        outcome = partial(_breaking_point, count, axis)
        yield CalibrationCheck(f"breaking point{name}", count, np.nan, outcome, MIN_COVERAGE_BOUNDS, np.nan)


def null_checks(count: int, fall_probability: float) -> Iterator[CalibrationCheck]:
    """Yield the checks of tests without a difference, for `count` episodes at a `fall_probability`."""
    rules: dict[str, tuple[CheckFunction, Interval, float]] = {
        "sign flips, exchangeable pairs": (
            partial(_sign_flip, count, fall_probability),
            TYPE_I_ERROR_BOUNDS,
            SIGNIFICANT,
        ),
        "McNemar, exchangeable pairs": (partial(_mcnemar, count, fall_probability), DISCRETE_TEST_BOUNDS, np.nan),
        "McNemar, ties by lot": (
            partial(_randomized_mcnemar, count, fall_probability),
            TYPE_I_ERROR_BOUNDS,
            SIGNIFICANT,
        ),
    }
    for name, (outcome, bounds, expected) in rules.items():
        yield CalibrationCheck(name, count, fall_probability, outcome, bounds, expected)


def rejection_rate(check: CalibrationCheck, sets: int, seed: int) -> float:
    """Compute the rate of positive results of a check.

    Args:
        check: Interval or test.
        sets: Number of data sets, each with its own generator.
        seed: Seed of the data sets.

    Returns:
        The rate, 0 … 1.
    """
    return float(np.mean([check.outcome(np.random.default_rng([seed, number])) for number in range(sets)]))


def _within(interval: Interval, truth: float) -> bool:
    return interval[0] <= truth <= interval[1]


def _make_episodes(
    generator: np.random.Generator, count: int, fall_probability: float, *ratios: float
) -> SyntheticEpisodes:
    """Create the episodes of a policy with that fall probability, and of others with a ratio to it."""
    return make_episodes(generator, (fall_probability, *(ratio * fall_probability for ratio in ratios)), count)


def _fall_rate(count: int, fall_probability: float, generator: np.random.Generator) -> bool:
    fell = _make_episodes(generator, count, fall_probability).fell[0]
    return _within(wilson_interval(int(fell.sum()), count), fall_probability)


def _mean(count: int, fall_probability: float, generator: np.random.Generator) -> bool:
    error = _make_episodes(generator, count, fall_probability).error[0]
    return _within(bootstrap_interval(error), mean_error(fall_probability))


def _fall_difference(count: int, fall_probability: float, generator: np.random.Generator) -> bool:
    a, b = _make_episodes(generator, count, fall_probability, FALL_RATIO).fell
    interval = paired_proportion_interval(int((a & ~b).sum()), int((b & ~a).sum()), count)
    return _within(interval, (1.0 - FALL_RATIO) * fall_probability)


def _mean_difference(count: int, fall_probability: float, generator: np.random.Generator) -> bool:
    a, b = _make_episodes(generator, count, fall_probability, FALL_RATIO).error
    return _within(difference_interval(a - b), mean_error(fall_probability) - mean_error(FALL_RATIO * fall_probability))


def _breaking_point(count: int, axis: SyntheticAxis, generator: np.random.Generator) -> bool:
    point = breaking_point(np.array(axis.severities), axis.falls(generator, count))
    return _within(point.ci, axis.breaking_point)


def _sign_flip(count: int, fall_probability: float, generator: np.random.Generator) -> bool:
    a, b = _make_episodes(generator, count, fall_probability, 1.0).error
    return sign_flip_test(a - b) < SIGNIFICANT


def _mcnemar(count: int, fall_probability: float, generator: np.random.Generator) -> bool:
    return mcnemar(*_make_episodes(generator, count, fall_probability, 1.0).fell) < SIGNIFICANT


def _randomized_mcnemar(count: int, fall_probability: float, generator: np.random.Generator) -> bool:
    """Return whether a randomised McNemar test is significant.

    A random draw decides the part of the probability of the observed outcome that counts, so that the test is exact at
    every level.
    """
    a, b = _make_episodes(generator, count, fall_probability, 1.0).fell
    rarer = min(int((a & ~b).sum()), int((b & ~a).sum()))
    discordant = int((a ^ b).sum())
    p_value = _mcnemar_p_value(rarer, discordant)
    p_value_beyond = _mcnemar_p_value(rarer - 1, discordant) if rarer else 0.0
    return p_value_beyond + generator.random() * (p_value - p_value_beyond) < SIGNIFICANT


@cache
def _mcnemar_p_value(only_a: int, discordant: int) -> float:
    """Return the p-value for a number of discordant pairs, and the number of them in which a alone fell."""
    pairs = np.arange(discordant) < only_a
    return mcnemar(pairs, ~pairs)


def all_checks(counts: Sequence[int], fall_probabilities: Sequence[float]) -> Iterator[CalibrationCheck]:
    """Yield every check.

    Args:
        counts: Numbers of episodes.
        fall_probabilities: Fall probabilities of the first policy.

    Yields:
        The checks.
    """
    for count in counts:
        for rules in (coverage_checks, null_checks):
            for fall_probability in fall_probabilities:
                yield from rules(count, fall_probability)
        yield from breaking_checks(count)
