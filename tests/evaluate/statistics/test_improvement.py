"""Interquartile mean against rliable 1.2.0, and improvement by episode by hand."""

import numpy as np
import pytest
from scipy import stats

from evaluate.statistics.improvement import (
    improvement_by_episode,
    interquartile_mean,
    interquartile_mean_interval,
)

X = np.array([0.31, 0.12, 0.55, 0.47, 0.29, 0.83, 0.21, 0.66, 0.12, 1.9])
Y = np.array([0.42, 0.12, 0.61, 0.40, 0.35, 0.79, 0.21, 0.98, 0.15, 1.2])
ROOTS = np.sqrt(np.arange(1.0, 41.0))


def test_interquartile_mean_is_rliables() -> None:
    # rliable.metrics.aggregate_iqm(X[:, None]), likewise Y and ROOTS
    assert interquartile_mean(X) == pytest.approx(0.415)
    assert interquartile_mean(Y) == pytest.approx(0.46333333)
    assert interquartile_mean(ROOTS) == pytest.approx(4.480728351474441)
    assert np.isnan(interquartile_mean(np.array([])))


def test_interquartile_mean_interval_is_rliables() -> None:
    # rliable.library.get_interval_estimates({"a": ROOTS[:, None]}, aggregate_iqm, reps=50000)
    assert interquartile_mean_interval(ROOTS) == pytest.approx((3.87398813, 5.01316536), abs=0.03)
    assert np.isnan(interquartile_mean_interval(ROOTS[:1])).all()


def test_interquartile_mean_of_values_that_agree() -> None:
    """Of two, 66 % may be others, of which the quarter at either end does not count; of 24, 14 % are all cut off."""
    unseen = (0.65763 - 0.25) / 0.5
    assert interquartile_mean_interval(np.full(2, 2.0), (0.0, 2.0)) == pytest.approx(
        (2.0 - 2.0 * unseen, 2.0), abs=1e-4
    )
    assert interquartile_mean_interval(np.full(24, 2.0), (0.0, 2.0)) == (2.0, 2.0)


@pytest.mark.parametrize("size", [5, 40, 63])
def test_resampled_interquartile_means_are_those_of_the_drawn_values(size) -> None:
    """Percentiles of scipy's trimmed means over values drawn one by one, with the same generator's draws."""
    values = np.random.default_rng(size).gamma(2.0, 1.0, size)
    drawn = np.random.default_rng(9).integers(0, size, (20_000, size))
    means = stats.trim_mean(values[drawn], 0.25, axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    assert interquartile_mean_interval(values) == pytest.approx((low, high), abs=0.06 * (high - low))


def test_improvement_by_episode_by_hand() -> None:
    # X is larger in 3 episodes of 10 and equal in 2; Y has larger values in all.
    probability, (low, high) = improvement_by_episode(X, Y)
    assert probability == pytest.approx((3 + 2 / 2) / 10)
    assert low < probability < high


def test_improvement_by_episode_sees_a_small_one_in_every_episode() -> None:
    better = ROOTS + 0.001
    assert improvement_by_episode(better, ROOTS)[0] == 1.0
    assert improvement_by_episode(better, ROOTS)[1][0] > 0.9


def test_ties_are_half_an_improvement() -> None:
    assert improvement_by_episode(X, X)[0] == 0.5


def test_improvement_without_episodes_does_not_exist() -> None:
    assert np.isnan(improvement_by_episode(X[:0], Y[:0])[0])
