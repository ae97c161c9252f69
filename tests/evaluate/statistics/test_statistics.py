"""Confidence intervals, compared with published values, scipy and hand counts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from evaluate.statistics import intervals
from evaluate.statistics.intervals import (
    BLOCK_VALUES,
    MAX_CACHED_VALUES,
    bootstrap_interval,
    difference_interval,
    mean_proportion_interval,
    paired_proportion_interval,
    resamples,
    wilson_interval,
)


def test_share_difference_interval_as_published() -> None:
    # Fagerland, Lydersen and Laake 2014, Statistics in Medicine 33, airway hyper-responsiveness: Tango's interval.
    assert paired_proportion_interval(1, 7, 21) == pytest.approx((-0.517, -0.026), abs=5e-4)


def test_share_difference_interval_ends_at_one() -> None:
    assert paired_proportion_interval(20, 0, 20)[1] == 1.0
    assert paired_proportion_interval(0, 20, 20)[0] == -1.0
    assert np.isnan(paired_proportion_interval(0, 0, 0)).all()


def test_intervals_of_too_few_values_do_not_exist() -> None:
    one = np.array([1.0])
    found = (wilson_interval(0, 0), bootstrap_interval(one), difference_interval(one))
    assert np.isnan(found).all()


def test_bootstrap_interval_is_scipys() -> None:
    sample = stats.lognorm(0.8).rvs(64, random_state=7)
    reference = stats.bootstrap((sample,), np.mean, n_resamples=20_000, batch=1000, rng=1).confidence_interval
    width = reference.high - reference.low
    assert bootstrap_interval(sample) == pytest.approx(tuple(reference), abs=0.03 * width)


@pytest.mark.parametrize(("pairs", "tail"), [(12, 0.010757), (128, 0.023484)])
def test_difference_interval_has_students_tails(monkeypatch, pairs, tail) -> None:
    """With 12 pairs, t is 2.20099 instead of 1.96, and the variance is 12 / 11: each tail is Φ(−2.29885) = 1.0757 %."""
    evenly = np.linspace(0.0, 1.0, 100_001)
    monkeypatch.setattr(intervals, "_resampled_sums", lambda values, *_: evenly * len(values))
    assert difference_interval(np.arange(float(pairs))) == pytest.approx((tail, 1.0 - tail), abs=2e-6)


def test_a_bootstrap_interval_is_moved_twice_by_its_bias(monkeypatch) -> None:
    """The values are symmetric, so the acceleration is zero; 40 % of the resamples lie below: z = -0.25335.

    The ends are the quantiles Φ(2 z ± 1.95996) of resamples that are spread evenly from 0 to 1.
    """
    evenly = np.linspace(0.0, 1.0, 100_001)
    monkeypatch.setattr(intervals, "_resampled_sums", lambda values, *_: evenly * len(values))
    symmetric = 0.4 + np.array([-0.3, -0.1, 0.1, 0.3] * 5)
    assert bootstrap_interval(symmetric) == pytest.approx((0.0068185, 0.926926), abs=1e-5)


def test_values_that_differ_by_rounding_alone_agree() -> None:
    """For the values 0.1 + 0.2 and 0.3, a bootstrap interval would be a point."""
    alike = np.tile([0.1 + 0.2, 0.3], 12)
    for interval in (bootstrap_interval, difference_interval):
        low, high = interval(alike, (0.0, 1.0))
        assert high - low == pytest.approx(0.13798, abs=1e-4)


@pytest.mark.parametrize("size", [5, MAX_CACHED_VALUES // 100, BLOCK_VALUES + 1])
def test_every_resample_draws_as_many_values_as_there_are(size) -> None:
    blocks = list(resamples(size, 101 if size < 100_000 else 3, seed=0))
    counts = np.concatenate(blocks)
    assert counts.shape == (101 if size < 100_000 else 3, size)
    assert (counts.sum(axis=1) == size).all()
    # A resample omits the share (1 - 1/n)^n of the values.
    assert (counts == 0).mean() == pytest.approx((1 - 1 / size) ** size, abs=0.03)


def test_values_that_agree_may_hide_as_many_others_as_wilsons_interval_has_for_none() -> None:
    """For 0 of 24, the upper end of Wilson's interval is z² / (24 + z²) = 3.8415 / 27.8415 = 0.13798."""
    unseen = 0.13798
    assert bootstrap_interval(np.full(24, 2.0), (0.0, 2.0)) == pytest.approx((2.0 - 2.0 * unseen, 2.0), abs=1e-4)
    assert bootstrap_interval(np.full(24, 0.5), (0.0, 2.0)) == pytest.approx((0.43101, 0.70697), abs=1e-4)
    assert difference_interval(np.zeros(24), (-1.0, 1.0)) == pytest.approx((-unseen, unseen), abs=1e-4)
    assert bootstrap_interval(np.full(24, 2.0)) == (-np.inf, np.inf)


@given(st.integers(1, 200).flatmap(lambda trials: st.tuples(st.integers(0, trials), st.just(trials))))
def test_wilson_interval_is_scipys(counts) -> None:
    reference = stats.binomtest(*counts).proportion_ci(0.95, method="wilson")
    assert wilson_interval(*counts) == pytest.approx(tuple(reference), abs=1e-12)


def test_no_share_lies_outside_0_and_1() -> None:
    ends = [wilson_interval(share * trials, trials) for trials in range(1, 120) for share in (0, 1)]
    assert min(low for low, _ in ends) >= 0.0
    assert max(high for _, high in ends) <= 1.0


def test_mean_share_interval_is_wilsons_with_the_number_of_trials_that_vary_as_much() -> None:
    """Twelve of 24 are 23 trials times (1.95996 / 2.06866)² = 0.89767 for Student's t; half shares vary a quarter."""
    shares = np.repeat([0.0, 1.0], 12)
    assert mean_proportion_interval(shares) == pytest.approx(wilson_interval(0.5 * 20.6465, 20.6465), abs=1e-5)
    halves = 0.25 + shares / 2.0
    assert mean_proportion_interval(halves) == pytest.approx(wilson_interval(0.5 * 82.586, 82.586), abs=1e-5)


def test_mean_share_interval_where_all_agree_counts_each_as_one_trial() -> None:
    assert mean_proportion_interval(np.ones(24)) == pytest.approx((1.0 - 0.13798, 1.0), abs=1e-5)
    assert mean_proportion_interval(np.zeros(2)) == pytest.approx((0.0, 0.65762), abs=1e-5)
    assert mean_proportion_interval(np.full(24, 0.75)) == wilson_interval(18, 24)
    assert mean_proportion_interval(np.ones(1)) == wilson_interval(1, 1)
    assert np.isnan(mean_proportion_interval(np.empty(0))).all()
