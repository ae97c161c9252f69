"""The group-sequential test spends the error rate that it says, and looks at pairs."""

import numpy as np
import pytest
from scipy.special import ndtr

from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.analysis.ranking import RANKING_WEIGHT
from evaluate.commands.looks import look
from evaluate.statistics.sequential import LEVEL, correction, looks, neighbours, nominal_levels, predicted
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


def test_a_single_look_is_an_ordinary_test_corrected_for_the_neighbours() -> None:
    assert nominal_levels(1, 2)[1] == pytest.approx(0.045)
    assert nominal_levels(1, 6)[1] == pytest.approx(0.009)
    assert correction(1, 1, 6) == pytest.approx(1.0)


def test_a_corrected_p_value_is_significant_in_a_report_where_its_look_distinguishes() -> None:
    assert pytest.approx(RANKING_WEIGHT * SIGNIFICANT) == LEVEL
    for episodes, level in nominal_levels(96, 6).items():
        assert holm([level * correction(episodes, 96, 6)], [RANKING_WEIGHT / 5]) == [pytest.approx(LEVEL / 5)]
        weights = [RANKING_WEIGHT / 5] * 5 + [1.0 - RANKING_WEIGHT]
        assert holm([level * correction(episodes, 96, 6)] * 5 + [1.0], weights)[0] == pytest.approx(SIGNIFICANT)


def test_neighbours_are_compared_pair_by_pair_from_the_best_on() -> None:
    luck = np.random.default_rng(2).uniform(0.0, 0.6, 24)
    scores = {"b": luck + 0.05, "c": luck[::-1], "a": luck + 0.1 + 0.01 * (np.arange(24) % 2)}
    first, second = neighbours(scores, 96)
    assert (first.ahead, first.behind, second.behind) == ("a", "b", "c")
    assert (first.distinguished, first.hopeless) == (True, False)
    assert not second.distinguished, "5 points are little beside the luck of unpaired episodes"


def test_equal_policies_are_given_up_and_near_ones_are_not() -> None:
    same = np.tile([0.0, 1.0], 24)
    assert neighbours({"a": same, "b": same}, 96)[0].hopeless
    assert predicted(1.0, 0.5, 0.03) < 0.02 < 0.4 < predicted(0.04, 0.5, 0.03) < predicted(0.001, 0.5, 0.03)
    assert (predicted(0.02, 1.0, 0.03), predicted(0.04, 1.0, 0.03)) == (1.0, 0.0)


def test_a_look_calls_policies_that_are_the_same_to_the_bit_so(made_up_cell) -> None:
    cells = [made_up_cell(name, np.arange(8) < falls) for name, falls in (("a", 2), ("b", 2), ("c", 3))]
    line, _ = look(cells, 16)
    assert "a = b (the same to the bit), b ~ c (p = " in line
