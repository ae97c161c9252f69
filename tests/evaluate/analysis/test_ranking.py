"""Whether the ranking of policies survives from one run to another."""

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import kendalltau

from evaluate.analysis.ranking import Ranking, rank_correlation, ranking
from evaluate.statistics.significance import sign_flip_test

EPISODES = 40
AXES = {"flat": "flat", "push:1": "push", "push:2": "push"}
POLICIES = "abc"


def rows(succeeded: dict[str, dict[str, np.ndarray]], first_seed: int = 0) -> pa.Table:
    """A run's rows, from scenario -> policy -> which episodes succeed; their order is not that of the seeds."""
    found = [
        {"scenario": scenario, "policy": policy, "seed": first_seed + seed, "outcome": "succeeded" if good else "fell"}
        for scenario, of in succeeded.items()
        for policy, each in of.items()
        for seed, good in enumerate(each)
    ]
    return pa.Table.from_pylist(found[::-1])


def first(*counts: int) -> dict[str, np.ndarray]:
    """So many of the first episodes succeed, of each policy."""
    return {policy: np.arange(EPISODES) < count for policy, count in zip(POLICIES, counts, strict=True)}


def of(a: pa.Table, b: pa.Table, axes=AXES) -> Ranking:
    return ranking([(policy, policy) for policy in POLICIES], axes, a, b)


def test_the_correlation_is_kendalls_also_where_policies_are_tied() -> None:
    generator = np.random.default_rng(0)
    a, b = generator.integers(0, 5, (2, 30, 6)) / 7.0
    expected = [kendalltau(x, y).statistic for x, y in zip(a, b, strict=True)]
    assert rank_correlation(a, b) == pytest.approx(expected)
    assert np.isnan(rank_correlation(np.full(4, 0.5), np.arange(4.0)))


def test_every_axis_and_every_scenario_of_it_counts_alike_in_the_scores() -> None:
    a = rows({"flat": first(40, 20, 0), "push:1": first(0, 20, 40), "push:2": first(20, 20, 20)})
    found = of(a, a)
    assert found.scores == (pytest.approx((0.625, 0.5, 0.375)),) * 2
    assert (found.correlation, found.reversals) == (pytest.approx(1.0), ())


def test_episodes_of_the_same_seeds_stay_paired() -> None:
    """A run and itself: the order is the same in every resample, however close the policies are."""
    generator = np.random.default_rng(0)
    succeeded = {name: {policy: generator.random(EPISODES) < 0.5 for policy in POLICIES} for name in AXES}
    assert of(rows(succeeded), rows(succeeded)).ci == pytest.approx((1.0, 1.0))
    low, high = of(rows(succeeded), rows(succeeded, first_seed=1000)).ci
    assert (low < 0.0, high) == (True, pytest.approx(1.0))
    assert "not shown" in next(of(rows(succeeded), rows(succeeded, first_seed=1000)).lines())


def test_common_seeds_alone_count() -> None:
    more = {name: first(*counts) for name, counts in zip(AXES, ((40, 30, 20),) * 3, strict=True)}
    fewer = {name: {policy: each[20:] for policy, each in of_it.items()} for name, of_it in more.items()}
    found = of(rows(more), rows(fewer, first_seed=20))
    assert found.scores == (pytest.approx((1.0, 0.5, 0.0)),) * 2


def test_a_reversal_takes_a_significant_difference_in_both_after_correction() -> None:
    a = rows({"flat": first(40, 30, 20), "push:1": first(40, 10, 20), "push:2": first(40, 20, 20)})
    b = rows({"flat": first(40, 30, 20), "push:1": first(40, 30, 20), "push:2": first(20, 40, 22)})
    found = of(a, b)
    (push,) = [each for each in found.reversals if each.scenario == "push:2" and each.better_in_b == "b"]
    assert (push.better_in_a, push.differences) == ("a", (pytest.approx(0.5), pytest.approx(-0.5)))
    # The smallest p-value of three pairs on three scenarios and in score: the larger one of A and B twelve fold.
    in_both = (sign_flip_test(np.repeat(each, 20)) for each in ([1.0, 0.0], [0.0, -1.0]))
    assert push.p_value_holm == pytest.approx(12 * max(in_both))
    (other,) = [each for each in found.reversals if each.scenario == "push:1"]
    assert (other.better_in_a, other.better_in_b) == ("c", "b")
    assert not [each for each in found.reversals if {each.better_in_a, each.better_in_b} == {"a", "c"}]  # by 2 episodes
    assert "reversed on push:2: a minus b is 50.0 points in A and −50.0 in B" in "".join(found.lines())


def test_the_answer_in_a_line() -> None:
    a = rows({name: first(40, 24, 8) for name in AXES})
    for scores, words in (((36, 20, 4), "yes"), ((4, 20, 36), "no"), ((20, 40, 4), "in part")):
        line = next(of(a, rows({name: first(*scores) for name in AXES})).lines())
        assert line.startswith(f"does the ranking survive? {words}: Kendall's tau of 3 policies' scores")
