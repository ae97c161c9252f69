"""Intervals over training seeds and episodes: planted tables with known intervals, and coverage of the true value."""

import numpy as np
import pytest
import scipy.stats

from evaluate.statistics import training_seeds
from evaluate.statistics.intervals import mean_proportion_interval, wilson_interval
from evaluate.statistics.training_seeds import (
    interquartile_mean,
    interquartile_mean_interval,
    mean_interval,
    rate_interval,
)

EPISODES = 24


def width(interval: tuple[float, float]) -> float:
    return interval[1] - interval[0]


def planted(rates: list[float], episodes: int = 1000) -> np.ndarray:
    """Return success of seeds with exactly these rates, with no other variation that counts, (s, n)."""
    return np.stack([(np.arange(episodes) < rate * episodes).astype(float) for rate in rates])


def drawn(rng: np.random.Generator, seeds: int, spread: float, scenarios: int = 8) -> tuple[np.ndarray, float]:
    """Return scores of seeds whose log odds have this standard deviation, (s, n), and the true mean."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(41)
    offsets = np.linspace(-1.0, 1.0, scenarios)
    noise = np.hypot(spread, 0.5)
    truth = np.average(scipy.special.expit(1.0 + noise * nodes[:, None] + offsets).mean(axis=1), weights=weights)
    odds = 1.0 + spread * rng.normal(size=(seeds, 1, 1)) + 0.5 * rng.normal(size=(1, EPISODES, 1)) + offsets
    return (rng.random((seeds, EPISODES, scenarios)) < scipy.special.expit(odds)).mean(axis=2), float(truth)


@pytest.mark.parametrize("interval", [rate_interval, mean_interval])
@pytest.mark.parametrize("rates", [[0.3, 0.5, 0.7, 0.4, 0.6], [0.35, 0.65, 0.5, 0.55, 0.45, 0.6, 0.4, 0.5]])
def test_with_many_episodes_the_interval_is_that_of_students_t_over_the_seeds(interval, rates) -> None:
    means = np.array(rates)
    half = scipy.stats.t.ppf(0.975, len(rates) - 1) * scipy.stats.sem(means)
    low, high = interval(np.repeat(means[:, None], 1000, axis=1) if interval is mean_interval else planted(rates))
    assert (low, high) == pytest.approx((means.mean() - half, means.mean() + half), abs=0.1 * half + 0.03)


@pytest.mark.parametrize("interval", [rate_interval, mean_interval])
def test_variation_between_seeds_widens_the_interval(interval) -> None:
    rng = np.random.default_rng(0)
    alike = (rng.random((5, EPISODES)) < 0.5).astype(float)
    apart = (rng.random((5, EPISODES)) < np.array([[0.1], [0.3], [0.5], [0.7], [0.9]])).astype(float)
    assert width(interval(apart)) > 1.5 * width(interval(alike))
    assert width(wilson_interval(apart.sum(), apart.size)) < 0.4 * width(interval(apart))


def test_the_interval_contains_the_truth_where_one_that_ignores_seeds_does_not() -> None:
    rng = np.random.default_rng(2)
    hits = np.zeros(3)
    tables = 200
    for _ in range(tables):
        scores, truth = drawn(rng, seeds=5, spread=0.8)
        ignoring = mean_proportion_interval(scores.ravel())
        for index, (low, high) in enumerate((rate_interval(scores), mean_interval(scores), ignoring)):
            hits[index] += low <= truth <= high
    by_rate, by_mean, by_ignoring = hits / tables
    assert min(by_rate, by_mean) >= 0.92
    assert by_ignoring < 0.8


def test_the_interquartile_mean_is_that_of_rliable() -> None:
    values = np.random.default_rng(3).random((4, 11))
    np.testing.assert_allclose(interquartile_mean(values), scipy.stats.trim_mean(values, 0.25, axis=1), rtol=1e-14)
    assert interquartile_mean(np.array([0.0, 0.5, 0.5, 100.0])) == 0.5


def test_the_interval_of_the_interquartile_mean_widens_with_seeds_and_leaves_out_an_outlier() -> None:
    rng = np.random.default_rng(4)
    values = (rng.random((5, EPISODES, 8)) < 0.8).astype(float)
    one_failed = values.copy()
    one_failed[2] = 0.0
    assert abs(interquartile_mean(one_failed.mean(axis=1).ravel()) - 0.8) < 0.05
    assert one_failed.mean() < 0.7
    spread = (rng.random((5, EPISODES, 8)) < np.linspace(0.4, 1.0, 5)[:, None, None]).astype(float)
    assert width(interquartile_mean_interval(spread)) > 2.0 * width(interquartile_mean_interval(values))
    low, high = interquartile_mean_interval(values)
    assert low < interquartile_mean(values.mean(axis=1).ravel()) < high


def test_seeds_that_all_succeed_have_an_interval_for_as_many_trials_as_seeds() -> None:
    ones = np.ones((5, EPISODES))
    assert rate_interval(ones) == wilson_interval(5, 5)
    assert mean_interval(ones, (0.0, 1.0)) == pytest.approx(wilson_interval(5, 5))


def test_two_seeds_have_the_interval_of_a_rate_and_no_bootstrap() -> None:
    two = (np.random.default_rng(5).random((2, EPISODES)) < np.array([[0.6], [0.8]])).astype(float)
    assert width(rate_interval(two)) > 0.5
    assert np.isnan(mean_interval(two)).all()
    assert np.isnan(interquartile_mean_interval(two[:, :, None])).all()


def test_one_policy_has_an_interquartile_mean_with_an_interval_over_episodes() -> None:
    values = (np.random.default_rng(6).random((1, EPISODES, 8)) < 0.7).astype(float)
    low, high = interquartile_mean_interval(values)
    assert low < interquartile_mean(values.mean(axis=1).ravel()) < high


def test_one_seed_has_no_interval() -> None:
    for interval in (rate_interval, mean_interval):
        assert np.isnan(interval(np.ones((1, EPISODES)))).all()


def test_the_draws_of_seeds_and_of_episodes_are_independent() -> None:
    square = np.eye(6)[:, :, None]  # Equal draws would draw the diagonal together: the mean would almost double.
    resampled = np.concatenate([*training_seeds._resampled_statistics(square, is_interquartile=False)])
    assert resampled.mean() == pytest.approx(square.mean(), rel=0.05)
