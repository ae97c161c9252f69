"""Table of the measures: complete, with correct columns."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq

from evaluate.measures import metrics
from evaluate.measures.catalogue import BY_NAME, FIGURES, MEASURES, OF_CAUSES
from evaluate.measures.episodes import empty_signal
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful


def test_every_measure_is_in_the_table_once() -> None:
    """Each measure has its own title, and each figure is one number per episode."""
    measured = metrics.measure(uneventful(SIMPLE_QUAD, 200, 3))
    assert sorted(measure.name for measure in MEASURES) == sorted(metrics.MEASURE_NAMES)
    assert len({measure.title for measure in MEASURES}) == len(MEASURES)
    verdicts = {"outcome", "fell", "diverged", *OF_CAUSES}
    for name in BY_NAME:
        value = getattr(measured, name)
        assert (name in FIGURES) == (value.shape == (3,) and name not in verdicts), name


def test_every_measure_is_a_column_and_every_figure_in_the_results(run) -> None:
    assert set(BY_NAME) <= set(pq.read_table(run.folder / "episodes.parquet").column_names)
    for policy in run.results["policies"].values():
        for cell in policy["scenarios"].values():
            assert set(cell["figures"]) == set(FIGURES)
            for name in ("velocity_error", "overspeed", "energy", "velocity_error_upright"):
                assert cell["figures"][name] == cell[name], name


def test_measures_go_by_the_figures_of_the_recorded_robot() -> None:
    """A robot with half the rated speed has measures with its own scale."""
    other = replace(SIMPLE_QUAD, rated_speed=5.0)
    moving = {"joint_velocity": empty_signal(SIMPLE_QUAD, "joint_velocity", 200, 1) + np.float32(7.0)}
    ours, others = (metrics.measure(uneventful(robot, 200, **moving)) for robot in (SIMPLE_QUAD, other))
    assert (ours.overspeed[0], others.overspeed[0]) == (0.0, 1.0)
