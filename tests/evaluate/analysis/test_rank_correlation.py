"""Rank correlation of policies between two runs."""

import numpy as np
import pytest
from scipy.stats import kendalltau

from evaluate.analysis.rank_correlation import kendall_tau, rank_correlation

POLICIES = "abc"


def first(*counts: int) -> np.ndarray:
    """Return the successes of policies in 40 episodes, (3, 40); each policy succeeds in its first `counts` episodes."""
    return (np.arange(40) < np.array(counts)[:, None]).astype(float)


def test_the_correlation_is_kendalls_also_where_policies_are_tied() -> None:
    generator = np.random.default_rng(0)
    a, b = generator.integers(0, 5, (2, 30, 6)) / 7.0
    expected = [kendalltau(x, y).statistic for x, y in zip(a, b, strict=True)]
    assert kendall_tau(a, b) == pytest.approx(expected)
    assert np.isnan(kendall_tau(np.full(4, 0.5), np.arange(4.0)))


def test_episodes_of_the_same_seeds_stay_paired() -> None:
    """A run compared with itself has the same order in every resample, with any distance between the policies."""
    generator = np.random.default_rng(0)
    scores = generator.random((3, 40))
    found = rank_correlation(POLICIES, scores, scores)
    assert found.ci == pytest.approx((1.0, 1.0))
    assert found.scores == (tuple(scores.mean(axis=1)),) * 2
    shuffled = rank_correlation(POLICIES, scores, generator.permuted(scores, axis=1))
    assert (shuffled.ci[0] < 0.0, shuffled.ci[1]) == (True, pytest.approx(1.0))
    assert "not shown" in next(shuffled.lines())


def test_the_answer_in_a_line() -> None:
    a = first(40, 24, 8)
    for counts, words in (((36, 20, 4), "yes"), ((4, 20, 36), "no"), ((20, 40, 4), "in part")):
        line = next(rank_correlation(POLICIES, a, first(*counts)).lines())
        assert line.startswith(f"does the ranking survive? {words}: Kendall's tau of 3 policies' scores")
