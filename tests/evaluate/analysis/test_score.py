"""Score: axes and severities have equal weights, and the episodes are the random sample."""

import dataclasses

import numpy as np
import pytest

from evaluate.analysis.results import analyse, results_to_json
from evaluate.analysis.score import compute_scores
from evaluate.rollouts.battery import resolve
from evaluate.statistics.intervals import difference_interval, mean_proportion_interval, wilson_interval
from evaluate.statistics.significance import sign_flip_test

COUNT = 40


@pytest.fixture
def cells(made_up_cell):
    """Return a function that makes cells on flat and on push at three severities, with numbers of initial falls."""

    def make(policy, **falls):
        return [
            made_up_cell(policy, np.arange(COUNT) < fallen, None, resolve((name.replace("_", ":"),))[0])
            for name, fallen in falls.items()
        ]

    return make


def test_every_axis_and_every_severity_of_it_counts_alike(cells) -> None:
    (found,) = compute_scores(cells("trot", flat=10, push=0, push_3=20, push_5=40), "trot")
    assert found.axes == {"flat": (0.75,), "push": (1.0, 0.5, 0.0)}
    assert found.score == pytest.approx((0.75 + (1.0 + 0.5 + 0.0) / 3) / 2)
    assert found.ci[0] < found.score < found.ci[1]
    assert found.difference == 0.0
    assert np.isnan([*found.difference_ci, found.p_value]).all()


def test_differences_are_paired_by_episode_and_the_best_comes_first(cells) -> None:
    both = cells("trot", flat=4, push=20) + cells("stand", flat=0, push=16)
    best, base = compute_scores(both, "trot")
    assert (best.policy, base.policy) == ("stand", "trot")
    assert best.difference == pytest.approx((4 + 4) / 2 / COUNT)
    assert 0.0 < best.difference_ci[0] < best.difference < best.difference_ci[1]
    assert best.p_value < 0.01  # eight pairs, all with the same sign


def test_an_interval_counts_episodes_each_with_all_of_its_scenarios(cells) -> None:
    """The same ten episodes fall in every scenario: their thirty scenarios are no more evidence than one scenario."""
    everywhere = dict.fromkeys(("flat", "push", "push_3", "rough"), 10)
    base, (found,) = np.arange(COUNT) < 20, compute_scores(cells("trot", **everywhere), "trot")
    succeeded = np.where(np.arange(COUNT) < 10, 0.0, 1.0)
    assert found.ci == mean_proportion_interval(succeeded)
    both = cells("trot", **dict.fromkeys(everywhere, 20)) + cells("stand", **everywhere)
    best = compute_scores(both, "trot")[0]
    assert best.policy == "stand"
    assert best.difference_ci == difference_interval(succeeded - ~base)
    assert best.p_value == sign_flip_test(succeeded - ~base)


def test_without_the_baselines_score_there_is_no_difference(cells) -> None:
    """The trot has no episodes on push; a score of 0 would be wrong."""
    (found,) = compute_scores(cells("trot", flat=0) + cells("stand", flat=4, push=20), "trot")
    assert found.policy == "stand"
    assert np.isnan([found.difference, *found.difference_ci, found.p_value]).all()


def ends(contents, place="") -> dict:
    """Yield every interval of results.json with its path."""
    entries = contents.items() if isinstance(contents, dict) else enumerate(contents)
    found = {}
    for name, value in entries:
        if str(name).endswith("ci"):
            found[f"{place}/{name}"] = value
        elif isinstance(value, dict | list):
            found |= ends(value, f"{place}/{name}")
    return found


@pytest.mark.parametrize("count", [2, 8])
def test_no_interval_has_no_width_where_all_episodes_agree(made_up_cell, count) -> None:
    """Four policies: one always succeeds, the others always fall, and all errors are equal."""
    policies = {"trot": False, "runs/a/seed-0": True, "runs/a/seed-1": True, "runs/a/seed-2": True}
    all_cells = [
        made_up_cell(policy, np.full(count, fell), np.full(count, 2.0 if fell else 0.5), resolve((name,))[0])
        for name in ("flat", "push:1", "push:2", "push:3")
        for policy, fell in policies.items()
    ]
    found = ends(results_to_json(analyse(all_cells, seed=0, episodes=count, complete=True)))
    known = {place: ci for place, ci in found.items() if None not in ci}
    assert {place.split("/")[1] for place in known} == {"ranking", "scores", "pareto", "policies", "comparisons"}
    assert [place for place, (low, high) in known.items() if low >= high] == []


def test_a_severity_that_two_scenarios_have_counts_once(cells) -> None:
    nominal = cells("trot", flat=0, push=20)
    twice = [*nominal, dataclasses.replace(nominal[1], scenario=resolve(("push:2",))[0])]
    assert compute_scores(twice, "trot")[0].score == compute_scores(nominal, "trot")[0].score


def test_a_policy_that_missed_a_scenario_has_no_score(cells) -> None:
    assert [
        each.policy for each in compute_scores(cells("trot", flat=0, push=1) + cells("document", flat=40), "trot")
    ] == ["trot"]
    other = [dataclasses.replace(cell, seeds=cell.seeds + 1) for cell in cells("stand", flat=0, push=1)]
    assert compute_scores(cells("trot", flat=0, push=1) + other, "trot") == []


def test_the_score_of_one_axis_is_the_success_on_it(cells) -> None:
    """Wilson's interval of 36 of 40 equals the interval of the scenario's share.

    The steady walk counts if it is alone.
    """
    (several,) = compute_scores(cells("trot", push=0, push_3=20), "trot")
    assert (several.score, several.axes) == (pytest.approx(0.75), {"push": (1.0, 0.5)})
    for name in ("push", "steady"):
        (one,) = compute_scores(cells("trot", **{name: 4}), "trot")
        assert (one.score, one.ci) == (pytest.approx(0.9), wilson_interval(36, 40))


def test_with_the_hardware_profile_and_without_it_there_are_two_scores(cells) -> None:
    """Each score uses only its own episodes, and both have the names of the axes; the steady walk is in neither."""
    ideal, real = (40, 0, 40), (0, 20, 40)
    names = "flat", "push", "push_4"
    both = cells("trot", steady=40, **dict(zip(names, ideal, strict=True)))
    both += cells("trot", **{"steady+hardware": 0, **{f"{n}+hardware": k for n, k in zip(names, real, strict=True)}})
    alone = compute_scores(cells("trot", **dict(zip(names, ideal, strict=True))), "trot")
    assert compute_scores(both, "trot") == alone
    (found,) = compute_scores(both, "trot", hardware=True)
    assert found.axes == {"flat": (1.0,), "push": (0.5, 0.0)}
    assert found.score == pytest.approx((1.0 + 0.25) / 2)
    results = analyse(both, seed=0, episodes=COUNT, complete=True)
    assert results.scores == tuple(alone)
    assert [each["score"] for each in results_to_json(results)["hardware_scores"]] == [found.score]


def test_a_policy_that_ran_in_one_world_alone_has_a_score_of_that_one(cells) -> None:
    both = cells("trot", flat=0, push=0) + cells("trot", **{"flat+hardware": 0, "push+hardware": 0})
    both += cells("stand", flat=0, push=0)
    assert {each.policy for each in compute_scores(both, "trot")} == {"trot", "stand"}
    assert [each.policy for each in compute_scores(both, "trot", hardware=True)] == ["trot"]
