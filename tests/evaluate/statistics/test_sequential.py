"""The group-sequential test keeps its error rate, and tests adjacent pairs."""

import numpy as np
import pytest
from scipy.special import ndtr, ndtri
from scipy.stats import multivariate_normal

from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.analysis.ranking import RANKING_WEIGHT
from evaluate.commands.interim_analysis import interim_analysis
from evaluate.statistics.sequential import (
    LEVEL,
    compare_adjacent_policies,
    correction,
    looks,
    nominal_levels,
    predictive_power,
)
from evaluate.statistics.significance import holm


def test_looks_are_quarters_of_the_most_episodes() -> None:
    assert looks(96) == (24, 48, 72, 96)
    assert (looks(10), looks(3), looks(1)) == ((3, 5, 8, 10), (1, 2, 3), (1,))


@pytest.mark.parametrize("policies", [2, 6])
def test_boundaries_spend_the_level_times_the_share_to_the_power_of_three_halves(policies) -> None:
    levels, level = nominal_levels(96, policies), LEVEL / (policies - 1)
    assert levels[24] == pytest.approx(level / 8)
    sums = np.random.default_rng(1).normal(size=(400_000, 4)).cumsum(axis=1)
    crossed = 2.0 * ndtr(-np.abs(sums) / np.sqrt([1, 2, 3, 4])) <= [levels[n] for n in looks(96)]
    spent = np.logical_or.accumulate(crossed, axis=1).mean(axis=0)
    assert spent == pytest.approx(level * np.array([0.25, 0.5, 0.75, 1.0]) ** 1.5, abs=3.5 * np.sqrt(level / 400_000))


@pytest.mark.parametrize("policies", [2, 6])
def test_the_second_boundary_is_that_of_the_normal_distribution_in_two_dimensions(policies) -> None:
    """The probability that the first sum is within ± z₁ √¼ and the second beyond ± z₂ √½ is the spent error.

    The correlation of both sums is √½.
    """
    levels, level = nominal_levels(96, policies), LEVEL / (policies - 1)
    first, second = (-ndtri(levels[n] / 2.0) for n in (24, 48))
    both = multivariate_normal(cov=[[1.0, np.sqrt(0.5)], [np.sqrt(0.5), 1.0]], abseps=1e-10, releps=1e-10)
    within = both.cdf([first, second], lower_limit=[-first, -second])
    spent = (1.0 - level * 0.25**1.5) - within
    assert spent == pytest.approx(level * (0.5**1.5 - 0.25**1.5), rel=2e-5)


def test_a_single_look_is_an_ordinary_test_corrected_for_the_neighbours() -> None:
    assert nominal_levels(1, 2)[1] == pytest.approx(0.045)
    assert nominal_levels(1, 6)[1] == pytest.approx(0.009)
    assert correction(1, 1, 6) == pytest.approx(1.0)


def test_a_time_limit_before_the_first_look_is_an_ordinary_test_and_six_policies_need_eight_episodes() -> None:
    for episodes, is_enough in ((7, False), (8, True)):
        levels = nominal_levels(48, 6, stopped_at=episodes)
        assert levels == {episodes: pytest.approx(0.009)}
        assert (2.0 / 2**episodes < levels[episodes]) == is_enough
        assert correction(episodes, 48, 6, is_last=True) == pytest.approx(1.0)


def test_a_corrected_p_value_is_significant_in_a_report_where_its_look_distinguishes() -> None:
    assert pytest.approx(RANKING_WEIGHT * SIGNIFICANT) == LEVEL
    for episodes, level in nominal_levels(96, 6).items():
        assert holm([level * correction(episodes, 96, 6)], [RANKING_WEIGHT / 5]) == [pytest.approx(LEVEL / 5)]
        weights = [RANKING_WEIGHT / 5] * 5 + [1.0 - RANKING_WEIGHT]
        assert holm([level * correction(episodes, 96, 6)] * 5 + [1.0], weights)[0] == pytest.approx(SIGNIFICANT)


def test_neighbours_are_compared_pair_by_pair_from_the_best_on() -> None:
    luck = np.random.default_rng(2).uniform(0.0, 0.6, 24)
    scores = {"b": luck + 0.05, "c": luck[::-1], "a": luck + 0.1 + 0.01 * (np.arange(24) % 2)}
    first, second = compare_adjacent_policies(scores, 96)
    assert (first.ahead, first.behind, second.behind) == ("a", "b", "c")
    assert (first.distinguished, first.futile) == (True, False)
    assert not second.distinguished, "5 points are little beside the luck of unpaired episodes"


def by_a_point(more: int, pairs: int) -> dict[str, np.ndarray]:
    """Return the scores of two policies.

    The first score is one point better in `more` of the episodes, else one point worse.
    """
    return {"first": np.repeat([1.0, -1.0], [more, pairs - more]), "second": np.zeros(pairs)}


def test_two_are_distinguished_by_the_level_of_the_look_and_not_by_that_of_the_last() -> None:
    """18 of 24 differences are positive: p = 0.0227 is between 0.045 / 8 of the first and 0.0282 of the last level."""
    (early,) = compare_adjacent_policies(by_a_point(18, 24), 96)
    assert early.p_value == pytest.approx(0.0227, abs=0.005)
    assert (early.distinguished, early.futile) == (False, False)
    (single,) = compare_adjacent_policies(by_a_point(18, 24), 24)
    assert single.distinguished  # the only analysis, at 0.045


def test_each_further_policy_leaves_less_for_two_neighbours() -> None:
    """47 of 72 differences are positive: p = 0.0128 is between 0.0195 for two policies and 0.00935 for three."""
    pair = by_a_point(47, 72)
    assert compare_adjacent_policies(pair, 96)[0].distinguished
    first, last = compare_adjacent_policies(pair | {"third": pair["second"] - 5.0}, 96)
    assert (first.ahead, first.behind, first.distinguished) == ("first", "second", False)
    assert last.distinguished


def test_two_are_given_up_by_the_level_of_the_last_look() -> None:
    """26 of 48 differences are positive, p = 0.665: the predictive power at 96 is 5.6 % at the last level, 0.0282.

    By the level of the present interim analysis, 0.0121, it would be 2.9 %. With 25 of 48, p = 0.885, it is 2.3 %.
    """
    (near,), (equal,) = (compare_adjacent_policies(by_a_point(more, 48), 96) for more in (26, 25))
    assert (near.p_value, equal.p_value) == pytest.approx((0.665, 0.885), abs=0.01)
    assert (near.futile, equal.futile) == (False, True)


def test_the_chance_of_the_last_look_is_the_predictive_power_by_hand() -> None:
    """The power is Φ((z − z₁ √t) / √(1 − t)), with z and z₁ of the halved p-values.

    For p = 0.04, level 0.03 and t = ½: (2.0537 − 2.1701 · 0.70711) / 0.70711 = 0.7343. For p = 0.2 and t = ¼: (1.2816 −
    1.0850) / 0.86603 = 0.2269.
    """
    assert predictive_power(0.04, 0.5, 0.03) == pytest.approx(0.7686, abs=1e-4)
    assert predictive_power(0.2, 0.25, 0.03) == pytest.approx(0.5897, abs=1e-4)
    assert predictive_power(1.0, 0.5, 0.03) == pytest.approx(ndtr(-2.1701), abs=1e-5)  # p = 1: z = 0
    assert (predictive_power(0.02, 1.0, 0.03), predictive_power(0.04, 1.0, 0.03)) == (1.0, 0.0)


def test_equal_policies_are_given_up() -> None:
    same = np.tile([0.0, 1.0], 24)
    assert compare_adjacent_policies({"a": same, "b": same}, 96)[0].futile


def test_a_look_calls_policies_that_are_the_same_to_the_bit_so(made_up_cell) -> None:
    cells = [made_up_cell(name, np.arange(8) < falls) for name, falls in (("a", 2), ("b", 2), ("c", 3))]
    line, _ = interim_analysis(cells, 16)
    assert "a = b (the same to the bit), b ~ c (p = " in line
