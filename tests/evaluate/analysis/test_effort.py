"""Effort of a cell: the cost of transport is a ratio of sums."""

from dataclasses import replace

import numpy as np
import pytest

from evaluate.analysis.effort import cost_by_episode, effort_by_episode, mean_and_interval
from evaluate.analysis.summary import summarise
from evaluate.measures.catalogue import EFFORT
from quad_env.robots.simple_quad import SIMPLE_QUAD


def test_the_cost_of_transport_is_that_of_all_episodes_together() -> None:
    """400 J over 10 N · 5 m is 8; the mean of 100/(10 · 1) and 300/(10 · 4) would be 8.75."""
    values = cost_by_episode(np.array([100.0, 300.0]), np.array([1.0, 4.0]), 10.0)
    assert values.tolist() == [pytest.approx(8.0 + (100 - 80) / 25), pytest.approx(8.0 + (300 - 320) / 25)]
    assert values.mean() == pytest.approx(8.0)


def test_its_interval_is_that_of_a_bootstrap_of_the_quotient() -> None:
    generator = np.random.default_rng(0)
    distance = generator.uniform(2.0, 9.0, 40)
    energy = 100.0 * (distance + generator.gamma(2.0, 0.3, 40))
    picked = generator.integers(0, 40, (9999, 40))
    ends = np.quantile(energy[picked].sum(axis=1) / (100.0 * distance[picked].sum(axis=1)), [0.025, 0.975])
    mean, ci = mean_and_interval(cost_by_episode(energy, distance, 100.0), "cost_of_transport")
    assert mean == pytest.approx(energy.sum() / (100.0 * distance.sum()))
    assert ci == pytest.approx(tuple(ends), abs=0.1 * (ends[1] - ends[0]))


def test_what_goes_nowhere_has_no_cost() -> None:
    values = cost_by_episode(np.array([100.0, 300.0]), np.array([0.0, 1.9]), 10.0)
    assert np.isnan(values).all()
    mean, ci = mean_and_interval(values, "cost_of_transport")
    assert np.isnan([mean, *ci]).all()


def test_a_summary_has_every_figure_and_the_duty_factor_of_all_feet(made_up_cell) -> None:
    cell = made_up_cell("trot", np.zeros(4, bool))
    known = {name: np.array([0.1, 0.3, np.nan, 0.2]) for name in EFFORT}
    known |= {"duty_factor": np.tile([0.4, 0.6, 0.5, 0.9], (4, 1)), "energy": np.full(4, 80.0)}
    cell = replace(cell, measures=replace(cell.measures, **known, distance=np.array([1.0, 1.0, 2.0, 4.0])))
    found = summarise(cell, SIMPLE_QUAD)
    assert tuple(found.effort) == tuple(found.effort_intervals) == EFFORT
    assert found.effort["duty_factor"] == pytest.approx(0.6)
    assert found.effort["flight"] == pytest.approx(0.2)  # the mean of the episodes that have a value
    assert found.effort["cost_of_transport"] == pytest.approx(found.cost_of_transport)
    assert found.effort_intervals["flight"][0] < 0.2 < found.effort_intervals["flight"][1]
    assert effort_by_episode(lambda name: known.get(name, np.ones(4)), 10.0)["step_rate"].tolist()[:2] == [0.1, 0.3]
