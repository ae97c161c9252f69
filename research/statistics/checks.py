"""Checks of intervals and tests on synthetic data sets, with bounds on the rate of positive results.

A result is positive if an interval contains the true value, or if a test is significant.
"""

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
"""Bounds of the coverage: the fraction of the 95 % intervals that contain the true value."""
TYPE_I_ERROR_BOUNDS = (0.04, 0.06)
"""Bounds of the fraction of tests at the 5 % level that are significant although there is no difference."""
DISCRETE_TEST_BOUNDS = (0.0, 0.06)
"""Bounds of the fraction of significant tests of counts if there is no difference.

The p-value of counts has few possible values. It may skip values near 5 %, and then fewer than 5 % of the tests are
significant."""
FALL_RATIO = 0.8
"""Fall probability of the second policy, divided by the fall probability of the first policy."""
MIN_COVERAGE_BOUNDS = (0.93, 1.0)
"""Bounds of the coverage of 95 % intervals that are allowed to be wider than necessary."""
PUSHES = (20.0, 35.0, 50.0, 65.0, 80.0, 100.0)
"""Severities of a synthetic axis of pushes, N·s."""
HALF = (FallCurve(0.495, 25.0, 20.0), FallCurve(0.01, 49.5, 90.0), FallCurve(0.495, 60.0, 60.0))
"""Curves with a total fall probability of exactly one half at one of the severities."""
STRETCH = (FallCurve(0.45, 30.0, 12.0), FallCurve(0.55, 75.0, 12.0))
"""Curves with a total fall probability that is almost constant, below one half, over a range of severities."""
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
"""Suffix of the name of a check -> synthetic axis: logistic curves, and shapes that a logistic model cannot fit."""

CheckFunction = Callable[[np.random.Generator], bool]
"""Function that draws one data set and returns True if the interval or test has a positive result on it."""


@dataclass(frozen=True)
class CalibrationCheck:
    """Check of an interval or test, which is repeated on many data sets."""

    name: str
    """Name of the check, printed in its row."""
    count: int
    """Number of episodes in a data set."""
    fall_probability: float
    """Fall probability of the first policy; NaN in a check with several severities, which have no common value."""
    outcome: CheckFunction
    """Function that returns the result on one data set."""
    bounds: Interval
    """Bounds within which the rate of positive results must be."""
    expected: float = 0.95
    """Expected rate of positive results; NaN if it is not known."""


def coverage_checks(count: int, fall_probability: float) -> Iterator[CalibrationCheck]:
    """Yield the checks of the coverage of intervals, for `count` episodes at a `fall_probability`."""
    rules: dict[str, CheckFunction] = {
        "Wilson, falls": partial(_fall_rate, count, fall_probability),
        "BCa bootstrap, mean error": partial(_mean, count, fall_probability),
        "score, paired difference of falls": partial(_fall_difference, count, fall_probability),
        "bootstrap, paired difference of errors": partial(_mean_difference, count, fall_probability),
    }
    for name, outcome in rules.items():
        yield CalibrationCheck(name, count, fall_probability, outcome, COVERAGE_BOUNDS)


def breaking_checks(count: int) -> Iterator[CalibrationCheck]:
    """Yield the checks of the coverage of the intervals of breaking points, for `count` episodes."""
    for name, axis in AXES.items():
        outcome = partial(_breaking_point, count, axis)
        yield CalibrationCheck(f"breaking point{name}", count, np.nan, outcome, MIN_COVERAGE_BOUNDS, np.nan)


def null_checks(count: int, fall_probability: float) -> Iterator[CalibrationCheck]:
    """Yield the checks of tests on policies without a difference.

    Each data set has `count` episodes of policies with the same `fall_probability`.

    Args:
        count: Episodes of each policy in a data set.
        fall_probability: Probability that an episode ends in a fall.

    Yields:
        The checks.
    """
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
        check: Check of an interval or test.
        sets: Number of data sets, each drawn with a separate random generator.
        seed: Seed of the data sets.

    Returns:
        The fraction of the data sets with a positive result.
    """
    return float(np.mean([check.outcome(np.random.default_rng([seed, number])) for number in range(sets)]))


def _within(interval: Interval, truth: float) -> bool:
    return interval[0] <= truth <= interval[1]


def _make_episodes(
    generator: np.random.Generator, count: int, fall_probability: float, *ratios: float
) -> SyntheticEpisodes:
    """Draw the episodes of a policy with a `fall_probability`, and of one more policy per ratio.

    The fall probability of a further policy is its ratio times `fall_probability`.
    """
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
    """Return True if a randomised McNemar test is significant.

    The p-value counts a random fraction of the probability of the observed outcome, so that the test has exactly the
    nominal error rate at every level.
    """
    a, b = _make_episodes(generator, count, fall_probability, 1.0).fell
    rarer = min(int((a & ~b).sum()), int((b & ~a).sum()))
    discordant = int((a ^ b).sum())
    p_value = _mcnemar_p_value(rarer, discordant)
    p_value_beyond = _mcnemar_p_value(rarer - 1, discordant) if rarer else 0.0
    return p_value_beyond + generator.random() * (p_value - p_value_beyond) < SIGNIFICANT


@cache
def _mcnemar_p_value(only_a: int, discordant: int) -> float:
    """Return the p-value of McNemar's test from counts.

    Args:
        only_a: Number of discordant pairs in which only policy a fell.
        discordant: Number of discordant pairs, in which exactly one of the two policies fell.

    Returns:
        The p-value.
    """
    pairs = np.arange(discordant) < only_a
    return mcnemar(pairs, ~pairs)


def all_checks(counts: Sequence[int], fall_probabilities: Sequence[float]) -> Iterator[CalibrationCheck]:
    """Yield all checks, for each combination of an episode count and a fall probability.

    Args:
        counts: Numbers of episodes in a data set.
        fall_probabilities: Fall probabilities of the first policy.

    Yields:
        The checks.
    """
    for count in counts:
        for rules in (coverage_checks, null_checks):
            for fall_probability in fall_probabilities:
                yield from rules(count, fall_probability)
        yield from breaking_checks(count)
