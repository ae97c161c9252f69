"""Significance tests, compared with hand counts, scipy and statsmodels."""

import itertools

import numpy as np
import pytest

from evaluate.statistics import significance
from evaluate.statistics.significance import holm, mcnemar, sign_flip_test


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


def test_sign_flips_of_few_pairs_by_hand() -> None:
    # Of the 8 sign flips of (1, 2, 3) only +++ and −−− give |sum| = 6.
    assert sign_flip_test(np.array([1.0, 2.0, 3.0])) == pytest.approx(2 / 8)
    # 0.1 + 0.2 − 0.3 and its permutations differ in the last bits; the exact sums are equal.
    assert sign_flip_test(np.array([0.1, 0.2, 0.3, 0.1])) == pytest.approx(2 / 16)


def test_a_p_value_is_neither_zero_nor_more_than_one() -> None:
    assert sign_flip_test(np.full(128, -0.1)) == pytest.approx(1 / 100_000)
    assert sign_flip_test(np.zeros(128)) == 1.0


def test_random_sign_flips_have_the_chances_of_all_of_them() -> None:
    """Twenty differences have a p-value near 5 %; the mean over 30 seeds has a standard error of 0.0004."""
    differences = np.random.default_rng(7).laplace(0.42, 1.0, 20)
    signs = np.array(list(itertools.product((1.0, -1.0), repeat=10)))
    sums = (signs @ differences[:10])[:, None] + signs @ differences[10:]
    exact = (np.abs(sums) >= abs(differences.sum()) - 1e-9).mean()
    assert 0.03 < exact < 0.08
    found = np.mean([sign_flip_test(differences, seed) for seed in range(30)])
    assert found == pytest.approx(exact, abs=0.0015)


def test_the_observed_flip_is_counted_with_the_random_ones(monkeypatch) -> None:
    """499 of 9999 flips and the observed one are 500 of 10 000.

    With 5, more flips are drawn: 5 + 12 of 99 999, plus one.
    """
    drawn = iter([499, 10, 9, 8])
    monkeypatch.setattr(significance, "_flips_as_large", lambda *_: next(drawn))
    many = np.linspace(1.0, 2.0, 20)
    assert sign_flip_test(many) == 500 / 10_000
    assert sign_flip_test(many) == 11 / 10_000
    assert sign_flip_test(many) == 18 / 100_000


def test_sums_that_are_equal_on_paper_count_as_equal() -> None:
    """Sums of tenths differ in their last bits by the order of summation; sums of integers do not."""
    signs = np.array(list(itertools.product((1, -1), repeat=9)))
    for seed in range(60):
        tenths = np.random.default_rng(seed).integers(-4, 10, 9)
        exact = (np.abs(signs @ tenths) >= abs(tenths.sum())).mean()
        assert sign_flip_test(tenths / 10.0) == exact


def test_a_small_p_value_is_resolved_further() -> None:
    # Only the observed flip and its opposite of 2¹⁶ reach the sum; 9999 random flips could not separate this from 1e-4.
    assert 1e-5 <= sign_flip_test(np.linspace(1.0, 2.0, 16)) < 9e-5


def test_weighted_holm_by_hand() -> None:
    """The order is 0.01 / 0.2 of weight 1, then 0.06 / 0.5 of 0.8, then 0.3 / 0.3 of 0.3."""
    assert holm([0.06, 0.01, 0.3], [0.5, 0.2, 0.3]) == pytest.approx([0.096, 0.05, 0.3])
    assert holm([0.02, 0.02], [0.9, 0.1]) == pytest.approx([0.02 / 0.9] * 2)  # 0.02 / 0.1 of the remaining 0.1 is less


def test_holm_by_hand() -> None:
    assert holm([]) == []
    assert holm([0.04, 0.01]) == pytest.approx([0.04, 0.02])
    assert holm([0.4, 0.4, 0.4]) == [1.0, 1.0, 1.0]
