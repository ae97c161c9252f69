"""Ranking of one run: adjacent pairs compared by episode, one correction, and the number of episodes needed."""

import re

import numpy as np
import pytest
from scipy.stats import norm

from evaluate.analysis.results import Results, analyse, results_to_json
from evaluate.report.page import render
from evaluate.report.verdict import adjacent_pair_lines, ranking_verdict
from evaluate.rollouts.battery import resolve
from evaluate.statistics.intervals import difference_interval, paired_proportion_interval
from evaluate.statistics.significance import holm, mcnemar, sign_flip_test

COUNT = 40
AXES = "flat", "push", "rough", "stairs"


@pytest.fixture
def run(made_up_cell):
    """Return a function that makes a run: policy -> scenario -> successful episodes, (n,)."""

    def make(baseline="trot", errors=None, **policies) -> Results:
        error = {policy: np.full(COUNT, each) for policy, each in (errors or {}).items()}
        cells = [
            made_up_cell(policy, ~np.asarray(good), error.get(policy), resolve((name.replace("_", ":"),))[0])
            for policy, of in policies.items()
            for name, good in of.items()
        ]
        return analyse(cells, seed=0, episodes=cells[0].episodes, complete=True, baseline=baseline)

    return make


def alike(generator: np.random.Generator, worse: int, count: int = COUNT) -> tuple[dict, dict]:
    """Return the successes of two policies; the second policy fails in up to `worse` more episodes of each axis."""
    ease = generator.random(count) < 0.5
    first = {name: ease.copy() for name in AXES}
    second = {name: ease.copy() for name in AXES}
    for number, place in enumerate(np.flatnonzero(ease)[:worse]):
        second[AXES[number % len(AXES)]][place] = False
    return first, second


def values(of: dict) -> np.ndarray:
    """Return the mean success of each episode."""
    return np.mean([of[name] for name in AXES], axis=0)


def test_neighbours_are_paired_by_episode_each_with_all_of_its_scenarios(run) -> None:
    """Ten additional failures in 160 episodes are significant only in pairs, since episodes
    differ far more than policies.
    """
    first, second = alike(np.random.default_rng(0), 10)
    (found,) = run(trot=second, better=first).ranking.neighbours
    difference = values(first) - values(second)
    assert (found.better, found.worse, found.difference) == ("better", "trot", pytest.approx(10 / 160))
    assert found.ci == difference_interval(difference, (-1.0, 1.0))
    assert found.p_value == sign_flip_test(difference) == pytest.approx(2 / 2**10, rel=0.5)
    assert found.deviation == pytest.approx(difference.std(ddof=1))
    assert found.distinguished
    unpaired = values(first) - np.random.default_rng(1).permutation(values(second))
    assert sign_flip_test(unpaired) > 0.05


def test_the_most_successful_stands_first_with_its_cost(run) -> None:
    ranked = run(**{f"p{k}": dict.fromkeys(AXES, np.arange(COUNT) < k) for k in (10, 40, 0, 30)}).ranking
    assert [each.policy for each in ranked.places] == ["p40", "p30", "p10", "p0"]
    assert [(each.better, each.worse) for each in ranked.neighbours] == [("p40", "p30"), ("p30", "p10"), ("p10", "p0")]
    assert (ranked.axes, ranked.scenarios, ranked.episodes) == (4, AXES, COUNT)
    assert np.isnan([each.cost for each in ranked.places]).all()


def test_of_a_single_scenario_the_ranking_is_by_success_with_its_test(run) -> None:
    good, fair = np.arange(COUNT) < 36, np.arange(COUNT) >= 12
    results = run(trot={"push": fair}, other={"push": good})
    (found,) = results.ranking.neighbours
    assert found.ci == paired_proportion_interval(12, 4, COUNT)
    assert found.p_value == found.p_value_holm == mcnemar(good, fair)
    (success,) = (each for each in results.comparisons if each.metric == "success_rate")
    assert success.p_value_holm == found.p_value_holm  # one claim
    assert (found.better_on, next(adjacent_pair_lines(results.ranking)).count(";")) == ((), 1)


def test_one_correction_holds_for_the_ranking_and_for_single_scenarios(run) -> None:
    """Adjacent pairs have nine tenths of the weight; other pairs without the baseline have none for success."""
    policies = {
        name: dict.fromkeys(AXES, np.arange(COUNT) < k) for name, k in (("a", 40), ("b", 31), ("trot", 30), ("c", 12))
    }
    results = run(**policies)
    neighbours = results.ranking.neighbours
    success = [each for each in results.comparisons if each.metric == "success_rate"]
    claimed = [
        each for each in success if {each.a, each.b} in ({"a", "b"}, {"b", "trot"}, {"trot", "c"}, {"a", "trot"})
    ]
    assert len(claimed) == 4 * len(AXES)
    p_values = [each.p_value for each in (*neighbours, *claimed)]
    expected = holm(p_values, [0.9 / 3] * 3 + [0.1 / 16] * 16)
    assert [each.p_value_holm for each in (*neighbours, *claimed)] == pytest.approx(expected)
    assert np.isnan([each.p_value_holm for each in success if each not in claimed]).all()
    others = [each for each in results.comparisons if each.metric == "fall_rate"]
    assert not np.isnan([each.p_value_holm for each in others]).any()
    assert results.ranking.neighbours[2].better_on == AXES
    assert results_to_json(results)["ranking"]["neighbours"][0]["p_value_holm"] == neighbours[0].p_value_holm


def test_single_scenarios_and_all_together_do_not_contradict_each_other_in_words(run) -> None:
    first, second = alike(np.random.default_rng(0), 12)
    assert next(adjacent_pair_lines(run(trot=second, better=first).ranking)).endswith(
        "; no single scenario shows it, the 4 axes together do"
    )
    good, bad = np.ones(COUNT, bool), np.zeros(COUNT, bool)
    even = {"flat": good, "push": bad, "rough": good, "stairs": good}
    other = {"flat": good, "push": good, "rough": bad, "stairs": good}
    line = next(adjacent_pair_lines(run(trot=even, other=other).ranking))
    assert "cannot be distinguished" in line
    assert line.endswith("; but trot is better on rough and other is better on push")
    most = {"flat": good, "push": good, "rough": good, "stairs": bad}
    line = next(adjacent_pair_lines(run(trot={**even, "flat": bad}, other=most).ranking))
    assert line.startswith("other beats trot by 25.0 points [")
    assert line.endswith("; flat and push alone show it; but trot is better on stairs")


def test_the_episodes_that_would_be_needed_are_those_of_the_formula_and_find_the_difference(run) -> None:
    """The power is 80 % at the corrected level: the test detects simulated normal differences in about 80 %."""
    generator = np.random.default_rng(3)
    first = {name: generator.random(COUNT) < 0.62 for name in AXES}
    second = {name: generator.random(COUNT) < 0.55 for name in AXES}
    results = run(trot=second, other=first)
    (found,) = results.ranking.neighbours
    level = 0.05 * 0.9  # no claim is significant, so that all weights remain
    assert not any(each.p_value_holm < 0.05 for each in (*results.comparisons, found))
    quantile = norm.ppf(1 - level / 2)
    expected = ((quantile + norm.ppf(0.8)) * found.deviation / found.difference) ** 2 + quantile**2 / 2
    assert found.needed == np.ceil(expected)
    drawn = generator.normal(found.difference, found.deviation, (300, int(found.needed)))
    t = drawn.mean(axis=1) / drawn.std(axis=1, ddof=1) * np.sqrt(drawn.shape[1])
    assert np.mean(np.abs(t) > quantile) == pytest.approx(0.8, abs=0.07)
    assert f"cannot be distinguished with 40 episodes; about {found.needed:.0f} would" in next(
        adjacent_pair_lines(results.ranking)
    )


def test_policies_that_are_alike_in_every_episode(run) -> None:
    """Policies with equal success may differ in other metrics, and further episodes may differ."""
    of = dict.fromkeys(AXES, np.arange(COUNT) < 10)
    ranked = run(errors={"other": 0.1}, trot=of, other=of).ranking
    assert ranked.neighbours[0].ci[0] < 0.0 < ranked.neighbours[0].ci[1]
    assert (ranked.neighbours[0].needed, ranked.neighbours[0].p_value_holm) == (np.inf, 1.0)
    assert "more than 10000 would be needed" in next(adjacent_pair_lines(ranked))
    assert ranking_verdict(ranked).endswith("but is not distinguished from other")


def test_policies_that_are_the_same_to_the_bit_have_a_difference_of_zero_without_an_interval(run) -> None:
    of = dict.fromkeys(AXES, np.arange(COUNT) < 10)
    results = run(trot=of, other=of, third=dict.fromkeys(AXES, np.arange(COUNT) < 9))
    found = results.ranking.neighbours[0]
    assert (found.identical, found.difference, found.p_value_holm) == (True, 0.0, 1.0)
    assert np.isnan(found.ci).all()
    said = [next(adjacent_pair_lines(results.ranking)), ranking_verdict(results.ranking)]
    assert said[0] == "trot and other are the same to the bit in 40 episodes of each scenario"
    assert said[1].endswith("; other is the same to the bit")
    between = {each.a: each for each in results.comparisons if each.scenario == "flat" and each.metric == "fall_rate"}
    assert [between[name].identical for name in ("other", "third")] == [True, False]
    assert np.isnan(between["other"].ci).all()
    assert not np.isnan(between["third"].ci).any()
    score = {each.policy: each for each in results.scores}
    assert score["other"].difference == 0.0
    assert np.isnan(score["other"].difference_ci).all()
    assert not np.isnan(score["third"].difference_ci).any()
    page = render(results).replace("\u00a0", " ")
    rows = re.findall(r"<tr><td>other − trot<small>.*?</tr>", page)
    assert len(rows) == len(AXES)
    assert all("<td>0.0</td><td>the same to the bit</td>" in row for row in rows)


def test_an_interval_that_excludes_zero_is_called_what_the_corrected_test_shows(run) -> None:
    good = np.ones(COUNT, bool)
    worse = {name: good if name != "push" else np.arange(COUNT) >= 5 for name in AXES}
    results = run(errors={"other": 0.1}, trot=dict.fromkeys(AXES, good), other=worse)
    (push,) = (each for each in results.comparisons if (each.scenario, each.metric) == ("push", "success_rate"))
    (found,) = results.ranking.neighbours
    assert push.ci[1] < 0.0
    assert found.ci[0] > 0.0
    assert min(push.p_value_holm, found.p_value_holm) >= 0.05
    words = "cannot be distinguished"
    by_itself = "though its interval by itself excludes 0"
    assert words in next(adjacent_pair_lines(results.ranking))
    assert by_itself in next(adjacent_pair_lines(results.ranking))
    page = render(results).replace("\u00a0", " ")
    (row,) = re.findall(r"<tr><td>other − trot<small>push</small>.*?</tr>", page)
    assert f"{words}, p = " in row
    assert by_itself in row
    (even,) = re.findall(r"<tr><td>other − trot<small>flat</small>.*?</tr>", page)
    assert f"{words}, p = 1.00</td>" in even


def test_the_verdict(run) -> None:
    a, b = (dict.fromkeys(AXES, np.arange(COUNT) < k) for k in (40, 20))
    said = ranking_verdict(run(trot=b, other=a).ranking).replace("\u00a0", " ")
    assert said.startswith("other is best: success 100 % [91, 100], 50.0 points [")
    assert said.endswith("] more than trot")
    assert ranking_verdict(run(trot=a).ranking).replace("\u00a0", " ") == "trot: success 100 % [91, 100]"
