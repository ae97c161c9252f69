"""The score: axes alike, severities alike, episodes what chance draws."""

import dataclasses

import numpy as np
import pytest

from evaluate.analysis.results import analyse, as_json
from evaluate.analysis.score import scores
from evaluate.report.sections.success_section import success as section
from evaluate.rollouts.battery import resolve
from evaluate.statistics.intervals import bootstrap_interval, difference_interval
from evaluate.statistics.significance import sign_flip_test

COUNT = 40


@pytest.fixture
def cells(made_up_cell):
    """Flat at one severity and push at three: how many of the first episodes of each fall."""

    def make(policy, **falls):
        return [
            made_up_cell(policy, np.arange(COUNT) < fallen, None, resolve((name.replace("_", ":"),))[0])
            for name, fallen in falls.items()
        ]

    return make


def test_every_axis_and_every_severity_of_it_counts_alike(cells) -> None:
    (found,) = scores(cells("trot", flat=10, push=0, push_3=20, push_5=40), "trot")
    assert found.axes == {"flat": (0.75,), "push": (1.0, 0.5, 0.0)}
    assert found.score == pytest.approx((0.75 + (1.0 + 0.5 + 0.0) / 3) / 2)
    assert found.ci[0] < found.score < found.ci[1]
    assert (found.difference, found.p_value) == (0.0, 1.0)


def test_differences_are_paired_by_episode_and_the_best_comes_first(cells) -> None:
    both = cells("trot", flat=4, push=20) + cells("stand", flat=0, push=16)
    best, base = scores(both, "trot")
    assert (best.policy, base.policy) == ("stand", "trot")
    assert best.difference == pytest.approx((4 + 4) / 2 / COUNT)
    assert 0.0 < best.difference_ci[0] < best.difference < best.difference_ci[1]
    assert best.p_value < 0.01  # eight pairs, all of one sign


def test_an_interval_resamples_episodes_each_with_all_of_its_scenarios(cells) -> None:
    """The same ten episodes fall everywhere: thirty scenarios of them are no more evidence than one."""
    everywhere = dict.fromkeys(("flat", "push", "push_3", "rough"), 10)
    base, (found,) = np.arange(COUNT) < 20, scores(cells("trot", **everywhere), "trot")
    succeeded = np.where(np.arange(COUNT) < 10, 0.0, 1.0)
    assert found.ci == bootstrap_interval(succeeded)
    both = cells("trot", **dict.fromkeys(everywhere, 20)) + cells("stand", **everywhere)
    best = scores(both, "trot")[0]
    assert best.policy == "stand"
    assert best.difference_ci == difference_interval(succeeded - ~base)
    assert best.p_value == sign_flip_test(succeeded - ~base)


def test_a_severity_that_two_scenarios_have_counts_once(cells) -> None:
    nominal = cells("trot", flat=0, push=20)
    twice = [*nominal, dataclasses.replace(nominal[1], scenario=resolve(("push:2",))[0])]
    assert scores(twice, "trot")[0].score == scores(nominal, "trot")[0].score


def test_who_missed_a_scenario_has_no_score_and_one_axis_is_none(cells) -> None:
    assert [each.policy for each in scores(cells("trot", flat=0, push=1) + cells("document", flat=40), "trot")] == [
        "trot"
    ]
    assert scores(cells("trot", push=1, push_3=4), "trot") == []
    other = [dataclasses.replace(cell, seeds=cell.seeds + 1) for cell in cells("stand", flat=0, push=1)]
    assert scores(cells("trot", flat=0, push=1) + other, "trot") == []


def test_it_stands_in_results_json_and_opens_the_page(cells) -> None:
    results = analyse(cells("trot", flat=0, push=8, push_3=20), seed=0, episodes=COUNT, complete=True)
    (found,) = as_json(results)["scores"]
    assert (found["policy"], found["axes"]["push"]) == ("trot", [0.8, 0.5])
    page = section(results)
    assert page.count("<img") == 3
    assert "Success of each policy on each axis" in page
    alone = section(analyse(cells("trot", push=8), seed=0, episodes=COUNT, complete=True))
    assert alone.count("<img") == 1
