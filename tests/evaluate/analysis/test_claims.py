"""One correction for all claims of a report, and the number of episodes that a claim needs, by hand."""

from unittest.mock import Mock

import pytest

from evaluate.analysis.comparison import SUCCESS_RATE, Comparison
from evaluate.analysis.ranking import AdjacentPair, Ranking, correct_p_values, episodes_needed


def neighbours(better: str, worse: str, p_value: float) -> AdjacentPair:
    """Return a pair of policies with scores that differ by 0.1, and with a p-value."""
    return AdjacentPair(better, worse, 0.1, 0.1, (0.0, 0.2), p_value)


def ranked(*found: AdjacentPair, scenarios: tuple[str, ...] = ("flat", "push"), episodes: int = 10) -> Ranking:
    """Return a ranking with meaningless values except the number of policies."""
    places = tuple(Mock() for _ in range(len(found) + 1))
    return Ranking(False, len(scenarios), scenarios, episodes, places, found)


def compared(
    scenario: str, a: str, b: str, difference: float, p_value: float, metric: str = SUCCESS_RATE
) -> Comparison:
    """Return a comparison with a p-value that was corrected before."""
    return Comparison(scenario, a, b, metric, difference, (0.0, 0.0), p_value, "", 0.77)


def test_neighbours_share_nine_tenths_of_the_level_and_single_scenarios_the_rest() -> None:
    """The weights are 0.45 and 0.05 each for two pairs: 1 · 1e-5 / 0.05 twice, 0.9 · 0.02 / 0.45, 0.45 · 0.2 / 0.45."""
    shown = compared("flat", "a", "b", 0.5, 1e-5), compared("push", "a", "b", -0.5, 1e-5)
    other = compared("flat", "a", "b", 0.5, 1e-5, "energy")
    of, found = correct_p_values(ranked(neighbours("a", "b", 0.02), neighbours("b", "c", 0.2)), [*shown, other])
    assert [each.p_value_holm for each in of.neighbours] == pytest.approx([0.04, 0.2])
    assert [each.p_value_holm for each in found] == pytest.approx([2e-4, 2e-4, 0.77])
    assert [(each.better_on, each.worse_on) for each in of.neighbours] == [(("flat",), ("push",)), ((), ())]
    assert [each.distinguished for each in of.neighbours] == [True, False]


def test_only_scenarios_of_the_ranking_show_that_one_of_two_is_better() -> None:
    shown = compared("flat", "b", "a", -0.5, 1e-5), compared("rough", "a", "b", 0.5, 1e-5)
    of, found = correct_p_values(ranked(neighbours("a", "b", 0.5)), shown)
    assert [each.p_value_holm < 0.05 for each in found] == [True, True]
    assert (of.neighbours[0].better_on, of.neighbours[0].worse_on) == (("flat",), ())


def test_the_first_look_of_a_run_until_settled_costs_what_it_spends() -> None:
    """A quarter of the episodes spends the share 1 / 4^1.5 of the level: p-values of adjacent
    pairs are multiplied by eight.
    """
    alone = ranked(neighbours("a", "b", 0.004), episodes=10)
    at_once, looked = (
        correct_p_values(alone, ())[0].neighbours[0],
        correct_p_values(alone, (), limit=40)[0].neighbours[0],
    )
    assert (at_once.p_value_holm, looked.p_value_holm) == (pytest.approx(0.004), pytest.approx(0.032))


def test_a_ranking_on_one_scenario_claims_what_its_comparison_claims() -> None:
    """There is one claim, the claim of the ranking: 0.004 · 8 at the first interim analysis, over its own weight."""
    alone = ranked(neighbours("a", "b", 0.004), scenarios=("flat",), episodes=10)
    of, found = correct_p_values(alone, [compared("flat", "a", "b", 0.5, 0.004)], limit=40)
    assert (of.neighbours[0].p_value_holm, found[0].p_value_holm) == (pytest.approx(0.032), pytest.approx(0.032))


@pytest.mark.parametrize(
    ("deviation", "episodes", "needed"),
    [
        pytest.param(2.0, 20, 34, id="(1.960 + 0.842)² · 2² + 1.960² / 2 = 33.3"),
        pytest.param(2.0, 33, 34, id="one more than there are"),
        pytest.param(2.0, 40, 41, id="more than there are"),
        pytest.param(0.1, 0, 6, id="2^5 sign flips have no p-value below 2 / 32 > 0.05"),
    ],
)
def test_episodes_that_are_needed(deviation: float, episodes: int, needed: int) -> None:
    of = AdjacentPair("a", "b", 1.0, deviation, (0.0, 0.0), 0.5)
    assert episodes_needed(of, 0.05, episodes) == needed
