"""Families of comparisons, and claims of a comparison."""

import numpy as np
import pytest

from evaluate.analysis.comparison import METRICS, SIGNIFICANT, compare, compare_metrics, metric_by_episode
from evaluate.statistics.intervals import paired_proportion_interval
from quad_env import SCENARIOS

NEVER = np.zeros(64, bool)


def test_a_claim_takes_the_corrected_p_value(made_up_cell) -> None:
    """Six falls of the trot alone have p = 2/2⁶, and 4 · 2/2⁶ after correction for four comparisons of falls."""
    falling = np.arange(64) < 6
    policies, scenarios = ("trot", "a", "b"), (SCENARIOS["flat"], SCENARIOS["push"])
    cells = [
        made_up_cell(policy, falling if policy != "a" or scenario.name == "push" else NEVER, scenario=scenario)
        for scenario in scenarios
        for policy in policies
    ]
    falls = next(c for c in compare(cells) if c.metric == "fall_rate")
    assert (falls.scenario, falls.a, falls.b) == ("flat", "a", "trot")
    assert falls.p_value == pytest.approx(2 / 2**6)
    assert falls.p_value_holm == pytest.approx(4 * 2 / 2**6)
    assert falls.p_value_holm >= SIGNIFICANT
    alone = next(c for c in compare(cells[:2]) if c.metric == "fall_rate")
    assert alone.p_value_holm == alone.p_value
    assert alone.p_value_holm < SIGNIFICANT


def test_a_policy_alone_has_nothing_to_compare(made_up_cell) -> None:
    assert compare([made_up_cell("trot", NEVER)]) == []
    assert compare([]) == []
    first_named = compare([made_up_cell(policy, NEVER) for policy in "xy"])
    assert {c.b for c in first_named} == {"x"}


def test_more_success_is_a_gain_and_more_falls_are_none(made_up_cell) -> None:
    trot, a = NEVER.copy(), NEVER.copy()
    trot[:9], a[7:10] = True, True
    found = compare([made_up_cell("trot", trot), made_up_cell("a", a)])
    success, falls = (next(c for c in found if c.metric == f"{name}_rate") for name in ("success", "fall"))
    assert (success.difference, falls.difference) == (pytest.approx((7 - 1) / 64), pytest.approx((1 - 7) / 64))
    assert success.ci == paired_proportion_interval(7, 1, 64)


def test_no_fall_of_either_is_no_certainty(made_up_cell) -> None:
    cells = [made_up_cell("trot", NEVER), made_up_cell("a", NEVER, np.full(len(NEVER), 0.1))]
    falls = next(c for c in compare(cells) if c.metric == "fall_rate")
    low, high = falls.ci
    assert low == pytest.approx(-high)
    assert 0.03 < high < 0.08
    assert falls.p_value_holm >= SIGNIFICANT


def test_two_runs_of_the_same_episodes_are_compared_as_two_policies_of_one_run_are(made_up_cell) -> None:
    """The difference, its interval and its p-value are equal to the bit."""
    generator = np.random.default_rng(0)
    cells = [made_up_cell(name, generator.random(64) < 0.1, generator.gamma(2.0, 0.1, 64)) for name in ("trot", "new")]
    a, b = ({metric: metric_by_episode(cell, metric) for metric in METRICS} for cell in cells)
    policies = {each.metric: each for each in compare(cells)}
    for run in compare_metrics(a, b):
        expected = policies[run.metric]
        assert (run.ci, run.p_value, run.test) == (expected.ci, expected.p_value, expected.test)
        assert run.difference == pytest.approx(expected.difference)
