"""Checks of confidence intervals and significance tests on synthetic data sets with a known truth.

A check repeats one interval or test on many data sets. The result on a data set is positive if the interval contains
the true value, or if the test is significant. The rate of positive results must be within bounds.
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
"""Lower and upper bound of the coverage of 95 % intervals.

The coverage is the fraction of the intervals that contain the true value. The command `calibration` reports each check
with a coverage outside of these bounds.
"""
TYPE_I_ERROR_BOUNDS = (0.04, 0.06)
"""Lower and upper bound of the type I error rate of tests at the 5 % level.

The type I error rate is the fraction of significant tests if the compared policies do not differ. The command
`calibration` reports each check with a rate outside of these bounds.
"""
DISCRETE_TEST_BOUNDS = (0.0, 0.06)
"""Lower and upper bound of the type I error rate of tests of counts, for example of numbers of falls.

The lower bound is 0, because the p-value of counts has only few possible values. If none of these values is close to
5 %, fewer than 5 % of the tests are significant."""
FALL_RATIO = 0.8
"""Ratio of fall probabilities in a pair of synthetic policies: second policy divided by first policy."""
MIN_COVERAGE_BOUNDS = (0.93, 1.0)
"""Lower and upper bound of the coverage of 95 % intervals that may be wider than necessary.

The coverage is the fraction of the intervals that contain the true value.
"""
PUSHES = (20.0, 35.0, 50.0, 65.0, 80.0, 100.0)
"""Severities of the synthetic disturbance axis 'push': impulses, N·s."""
HALF = (FallCurve(0.495, 25.0, 20.0), FallCurve(0.01, 49.5, 90.0), FallCurve(0.495, 60.0, 60.0))
"""Fall curves (fall probability as a function of the severity, N·s) of three kinds of episodes.

Their sum, the fall probability of all episodes, is close to one half (0.502) at the severity 50 N·s.
"""
STRETCH = (FallCurve(0.45, 30.0, 12.0), FallCurve(0.55, 75.0, 12.0))
"""Fall curves (fall probability as a function of the severity, N·s) of two kinds of episodes.

Their sum, the fall probability of all episodes, is almost constant and below one half over a range of severities.
"""
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
"""Suffix of a check's name -> synthetic disturbance axis, on which breaking points are estimated.

A disturbance axis is a kind of disturbance with several severities. The breaking point is the severity at which half of
the episodes fall. On each axis, the fall probability is a logistic curve, or a curve that a logistic model cannot fit.
"""

CheckFunction = Callable[[np.random.Generator], bool]
"""Type of a function that draws a data set with a random generator, and computes an interval or test.

The result is True (positive) if the interval contains the true value, or if the test is significant.
"""


@dataclass(frozen=True)
class CalibrationCheck:
    """Check of a confidence interval or test, which `rejection_rate` repeats on many data sets."""

    name: str
    """Name of the check, which is printed with its rate of positive results."""
    count: int
    """Number of episodes in one data set of the check."""
    fall_probability: float
    """Fall probability of the first policy in the data sets.

    It is NaN in a check of breaking points, because that check has several severities of a disturbance."""
    outcome: CheckFunction
    """Function that draws one data set with a random generator, and returns True for a positive result.

    The result is positive if the interval contains the true value, or if the test is significant."""
    bounds: Interval
    """Lower and upper bound of the rate of positive results (true value in interval, or significant test)."""
    expected: float = 0.95
    """Theoretical rate of positive results (true value in interval, or significant test); NaN if unknown."""


def coverage_checks(count: int, fall_probability: float) -> Iterator[CalibrationCheck]:
    """Yield the checks of the coverage of confidence intervals.

    The coverage is the fraction of the intervals that contain the true value.

    Args:
        count: Number of episodes in a data set.
        fall_probability: Fall probability of the first policy.

    Yields:
        One check for each kind of interval.
    """
    rules: dict[str, CheckFunction] = {
        "Wilson, falls": partial(_fall_rate, count, fall_probability),
        "BCa bootstrap, mean error": partial(_mean, count, fall_probability),
        "score, paired difference of falls": partial(_fall_difference, count, fall_probability),
        "bootstrap, paired difference of errors": partial(_mean_difference, count, fall_probability),
    }
    for name, outcome in rules.items():
        yield CalibrationCheck(name, count, fall_probability, outcome, COVERAGE_BOUNDS)


def breaking_checks(count: int) -> Iterator[CalibrationCheck]:
    """Yield the checks of the intervals of breaking points, with `count` episodes per severity.

    A breaking point is the severity of a disturbance at which half of the episodes fall. Each check is about one
    synthetic disturbance axis. A check counts the intervals that contain the true breaking point.
    """
    for name, axis in AXES.items():
        outcome = partial(_breaking_point, count, axis)
        yield CalibrationCheck(f"breaking point{name}", count, np.nan, outcome, MIN_COVERAGE_BOUNDS, np.nan)


def null_checks(count: int, fall_probability: float) -> Iterator[CalibrationCheck]:
    """Yield the checks of the type I error rate of tests, on pairs of policies that do not differ.

    The type I error rate is the fraction of the tests that find a difference although there is none.

    Args:
        count: Number of episodes of each policy in a data set.
        fall_probability: Fall probability of both policies.

    Yields:
        One check for each kind of test.
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
    """Compute the fraction of data sets on which an interval has the true value, or a test is significant.

    Args:
        check: Check of an interval or test.
        sets: Number of data sets; each is drawn with a separate random generator.
        seed: Seed of the data sets.

    Returns:
        Fraction of the data sets on which the interval contains the true value or the test is significant.
    """
    return float(np.mean([check.outcome(np.random.default_rng([seed, number])) for number in range(sets)]))


def _within(interval: Interval, truth: float) -> bool:
    return interval[0] <= truth <= interval[1]


def _make_episodes(
    generator: np.random.Generator, count: int, fall_probability: float, *ratios: float
) -> SyntheticEpisodes:
    """Draw synthetic episodes of a first policy, and of one more policy for each ratio.

    Args:
        generator: Random generator.
        count: Number of episodes of each policy.
        fall_probability: Fall probability of the first policy.
        *ratios: Fall probability of each further policy, divided by the fall probability of the first policy.

    Returns:
        Falls and velocity errors of all policies on the same episodes.
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
    """Draw a data set, and return True if a randomised McNemar test of the falls is significant.

    The p-value includes a random fraction of the probability of the observed outcome. Therefore the type I error rate
    of the test is exactly its significance level.
    """
    a, b = _make_episodes(generator, count, fall_probability, 1.0).fell
    rarer = min(int((a & ~b).sum()), int((b & ~a).sum()))
    discordant = int((a ^ b).sum())
    p_value = _mcnemar_p_value(rarer, discordant)
    p_value_beyond = _mcnemar_p_value(rarer - 1, discordant) if rarer else 0.0
    return p_value_beyond + generator.random() * (p_value - p_value_beyond) < SIGNIFICANT


@cache
def _mcnemar_p_value(only_a: int, discordant: int) -> float:
    """Return the p-value of McNemar's test, which compares the fall rates of two policies.

    Args:
        only_a: Number of episodes in which only the first policy fell.
        discordant: Number of episodes in which exactly one of the two policies fell.

    Returns:
        The p-value.
    """
    pairs = np.arange(discordant) < only_a
    return mcnemar(pairs, ~pairs)


def all_checks(counts: Sequence[int], fall_probabilities: Sequence[float]) -> Iterator[CalibrationCheck]:
    """Yield all checks of intervals and tests, for each number of episodes and each fall probability.

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
