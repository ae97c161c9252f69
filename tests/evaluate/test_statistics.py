"""Intervals and tests against published values, hand counts and scipy."""

import numpy as np
import pytest
from scipy import stats

from evaluate.statistics import EXACT_PAIRS, bootstrap_interval, mcnemar, sign_flip_test, wilson_interval


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        # Newcombe 1998, Statistics in Medicine 17, Table I, method 3 (score, no continuity correction).
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_interval_as_published(successes, trials, low, high) -> None:
    assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=5e-5)


def test_wilson_interval_without_trials_does_not_exist() -> None:
    assert np.isnan(wilson_interval(0, 0)).all()


def outcomes(both: int, only_a: int, only_b: int, neither: int) -> tuple[np.ndarray, np.ndarray]:
    a = np.repeat([True, True, False, False], [both, only_a, only_b, neither])
    b = np.repeat([True, False, True, False], [both, only_a, only_b, neither])
    return a, b


def test_mcnemar_by_hand() -> None:
    # 1 against 5 disagreements: 2 · (C(6,0) + C(6,1)) / 2⁶ = 14/64.
    assert mcnemar(*outcomes(3, 1, 5, 20)) == pytest.approx(14 / 64)
    # 0 against 10: 2 / 2¹⁰.
    assert mcnemar(*outcomes(0, 0, 10, 118)) == pytest.approx(2 / 1024)


def test_mcnemar_looks_at_disagreements_alone() -> None:
    assert mcnemar(*outcomes(50, 2, 7, 0)) == mcnemar(*outcomes(0, 2, 7, 900))
    assert mcnemar(*outcomes(5, 0, 0, 5)) == 1.0


def test_sign_flips_of_three_pairs_by_hand() -> None:
    # Of the 8 flips of (1, 2, 3) only +++ and −−− reach |sum| = 6.
    assert sign_flip_test(np.array([1.0, 2.0, 3.0])) == pytest.approx(2 / 8)
    # |sum| of (1, 2, −3) is 0: every flip reaches it.
    assert sign_flip_test(np.array([1.0, 2.0, -3.0])) == 1.0


def test_flips_that_are_equal_on_paper_count_as_equal() -> None:
    # 0.1 + 0.2 − 0.3 and its kin differ from each other in the last bits.
    assert sign_flip_test(np.array([0.1, 0.2, 0.3, 0.1])) == pytest.approx(2 / 16)


@pytest.mark.parametrize("pairs", [5, EXACT_PAIRS])
def test_exact_sign_flips_equal_scipys(pairs) -> None:
    differences = np.random.default_rng(pairs).normal(0.4, 1.0, pairs)
    reference = stats.permutation_test((differences,), np.mean, permutation_type="samples", n_resamples=np.inf)
    assert sign_flip_test(differences) == pytest.approx(reference.pvalue)


def test_random_sign_flips_agree_with_the_exact_p_value() -> None:
    differences = np.random.default_rng(2).normal(0.5, 1.0, 16)
    reference = stats.permutation_test((differences,), np.mean, permutation_type="samples", n_resamples=np.inf)
    assert sign_flip_test(differences) == pytest.approx(reference.pvalue, abs=0.01)


def test_a_random_p_value_is_never_zero() -> None:
    assert sign_flip_test(np.full(128, -0.1)) == pytest.approx(1 / 10_000)


def test_no_difference_at_all_has_p_one() -> None:
    assert sign_flip_test(np.zeros(128)) == 1.0


def test_sign_flips_hold_their_level_without_a_difference() -> None:
    generator = np.random.default_rng(3)
    p_values = [sign_flip_test(generator.laplace(size=20)) for _ in range(200)]
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=0.04)


def test_bootstrap_interval_covers_the_true_mean_as_often_as_it_says() -> None:
    generator = np.random.default_rng(4)
    covered = 0
    for _ in range(150):
        low, high = bootstrap_interval(generator.exponential(1.0, 64))
        covered += low <= 1.0 <= high
    assert 0.88 <= covered / 150 <= 0.99


def test_bootstrap_interval_is_as_wide_as_the_normal_one_for_many_values() -> None:
    values = np.random.default_rng(5).normal(2.0, 0.5, 400)
    low, high = bootstrap_interval(values)
    assert (low + high) / 2 == pytest.approx(values.mean(), abs=0.01)
    assert high - low == pytest.approx(2 * 1.96 * 0.5 / np.sqrt(400), rel=0.1)


def test_bootstrap_interval_of_equal_values_is_that_value() -> None:
    assert bootstrap_interval(np.full(8, 2.0)) == (2.0, 2.0)
    assert bootstrap_interval(np.zeros(128)) == (0.0, 0.0)


def test_bootstrap_interval_of_one_value_does_not_exist() -> None:
    assert np.isnan(bootstrap_interval(np.array([1.0]))).all()


def test_statistics_repeat_themselves() -> None:
    values = np.random.default_rng(6).normal(0.1, 1.0, 64)
    assert bootstrap_interval(values) == bootstrap_interval(values)
    assert sign_flip_test(values) == sign_flip_test(values)
