"""Whether the ranking of policies survives from one run to another."""

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import kendalltau

from evaluate.analysis.rank_correlation import RankCorrelation, kendall, rank_correlation

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


def of(a: pa.Table, b: pa.Table, axes=AXES) -> RankCorrelation:
    return rank_correlation([(policy, policy) for policy in POLICIES], axes, a, b)


def test_the_correlation_is_kendalls_also_where_policies_are_tied() -> None:
    generator = np.random.default_rng(0)
    a, b = generator.integers(0, 5, (2, 30, 6)) / 7.0
    expected = [kendalltau(x, y).statistic for x, y in zip(a, b, strict=True)]
    assert kendall(a, b) == pytest.approx(expected)
    assert np.isnan(kendall(np.full(4, 0.5), np.arange(4.0)))


def test_every_axis_and_every_scenario_of_it_counts_alike_in_the_scores() -> None:
    a = rows({"flat": first(40, 20, 0), "push:1": first(0, 20, 40), "push:2": first(20, 20, 20)})
    found = of(a, a)
    assert found.scores == (pytest.approx((0.625, 0.5, 0.375)),) * 2
    assert found.correlation == pytest.approx(1.0)


def test_episodes_of_the_same_seeds_stay_paired() -> None:
    """A run and itself: the order is the same in every resample, however close the policies are."""
    generator = np.random.default_rng(0)
    succeeded = {name: {policy: generator.random(EPISODES) < 0.5 for policy in POLICIES} for name in AXES}
    assert of(rows(succeeded), rows(succeeded)).ci == pytest.approx((1.0, 1.0))
    shuffled = {
        name: {p: generator.permutation(each) for p, each in of_it.items()} for name, of_it in succeeded.items()
    }
    low, high = of(rows(succeeded), rows(shuffled)).ci
    assert (low < 0.0, high) == (True, pytest.approx(1.0))
    assert "not shown" in next(of(rows(succeeded), rows(shuffled)).lines())


def test_common_seeds_alone_count() -> None:
    more = {name: first(*counts) for name, counts in zip(AXES, ((40, 30, 20),) * 3, strict=True)}
    fewer = {name: {policy: each[20:] for policy, each in of_it.items()} for name, of_it in more.items()}
    found = of(rows(more), rows(fewer, first_seed=20))
    assert found.scores == (pytest.approx((1.0, 0.5, 0.0)),) * 2


def test_the_answer_in_a_line() -> None:
    a = rows({name: first(40, 24, 8) for name in AXES})
    for scores, words in (((36, 20, 4), "yes"), ((4, 20, 36), "no"), ((20, 40, 4), "in part")):
        line = next(of(a, rows({name: first(*scores) for name in AXES})).lines())
        assert line.startswith(f"does the ranking survive? {words}: Kendall's tau of 3 policies' scores")
