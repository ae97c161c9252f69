"""The table of measures: complete, and true to the columns it heads."""

from dataclasses import fields, replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from evaluate.measures import catalogue as measures
from evaluate.measures import metrics
from evaluate.measures.catalogue import BY_NAME, FIGURES, LISTS, MEASURES, VERDICTS
from evaluate.measures.episodes import TRUTHS, Episodes, blank, shapes
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures import test_effort, test_gait_quality, test_pushes
from tests.evaluate.measures.uneventful import uneventful


def test_every_measure_is_in_the_table_once() -> None:
    names = [measure.name for measure in MEASURES]
    assert sorted(names) == sorted(field.name for field in fields(metrics.Measures))
    assert len(BY_NAME) == len(names)
    assert sorted((*FIGURES, *LISTS, *VERDICTS)) == sorted(names)


def test_every_measure_says_what_it_is() -> None:
    for measure in MEASURES:
        assert measure.title, measure
        assert measure.formula, measure
        assert measure.formula.isascii(), measure.name
    assert len({measure.title for measure in MEASURES}) == len(MEASURES)


def test_figures_are_numbers_of_an_episode_and_lists_are_lists() -> None:
    measured = metrics.measure(uneventful(SIMPLE_QUAD, 200, 3))
    for name in FIGURES:
        assert getattr(measured, name).shape == (3,), name
        assert getattr(measured, name).dtype == np.float64, name
    for name in LISTS:
        assert getattr(measured, name).ndim > 1, name


def test_every_measure_is_a_column_of_the_episodes_table(run) -> None:
    columns = pq.read_table(run.folder / "episodes.parquet").column_names
    assert set(BY_NAME) <= set(columns)


def test_every_figure_is_in_the_results(run) -> None:
    for policy in run.results["policies"].values():
        for cell in policy["scenarios"].values():
            assert set(cell["figures"]) == set(FIGURES)
            for name in set(FIGURES) & {"velocity_error", "overspeed", "energy", "velocity_error_upright"}:
                assert cell["figures"][name] == cell[name], name


def test_what_could_flatter_a_robot_that_falls_is_labelled() -> None:
    """Of all figures where less is better, those that bill a fall are the contract's errors and nothing else."""
    billed = {m.name for m in MEASURES if m.name in FIGURES and m.better == "less" and m.scope == measures.WHOLE}
    assert billed == {"velocity_error", "yaw_rate_error", "mean_velocity_error"}


def test_every_signal_is_recorded() -> None:
    names = [field.name for field in fields(Episodes)]
    assert set(shapes(SIMPLE_QUAD)) < set(names)
    assert set(TRUTHS) < set(shapes(SIMPLE_QUAD))


def test_measures_go_by_the_figures_of_the_recorded_robot() -> None:
    """A robot with legs a third as long that is rated at half the speed."""
    other = replace(SIMPLE_QUAD, thigh_length=0.1, calf_length=0.1, rated_speed=5.0)
    moving = {
        "joint_velocity": blank(SIMPLE_QUAD, "joint_velocity", 200, 1) + np.float32(7.0),
        "heading_velocity": blank(SIMPLE_QUAD, "heading_velocity", 200, 1) + np.float32(1.0),
    }
    ours, others = (metrics.measure(uneventful(robot, 200, **moving)) for robot in (SIMPLE_QUAD, other))
    assert (ours.overspeed[0], others.overspeed[0]) == (0.0, 1.0)
    assert others.froude_number[0] == pytest.approx(3 * ours.froude_number[0])


def test_every_figure_is_checked_by_hand_and_has_a_fault() -> None:
    checked = {check.__name__ for module in (test_effort, test_gait_quality, test_pushes) for check in module.CHECKS}
    of_tracking = {name for name in FIGURES if name.startswith(("velocity_error", "yaw_rate", "mean_velocity"))}
    others = {"outcome", "fell", "diverged", "fall_time", "distance", "commands", "mean_velocities"}  # test_metrics
    assert checked | of_tracking | others == set(BY_NAME)
