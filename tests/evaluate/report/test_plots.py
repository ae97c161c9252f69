"""What the report's plots are drawn from."""

import numpy as np
import pytest

from evaluate.report.plots.gait_diagram import gait_diagram, stances
from evaluate.report.plots.push_plot import DIRECTIONS, fall_shares, push_plot
from quad_env.robots.simple_quad import SIMPLE_QUAD


def test_stances_are_the_stretches_on_the_ground() -> None:
    contact = np.array([1, 1, 0, 0, 1, 0, 1, 1, 1], bool)
    assert stances(contact) == [(0, 2), (4, 1), (6, 3)]
    assert stances(np.zeros(5, bool)) == []
    assert stances(np.ones(5, bool)) == [(0, 5)]


def test_pushes_are_sorted_by_direction_and_impulse() -> None:
    """Forward pushes of 20 N·s never fell the robot, those of 50 always; half of those to the left do."""
    forward, left = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    impulses = np.concatenate(
        [np.tile(20 * forward, (4, 1)), np.tile(50 * forward, (4, 1)), np.tile(50 * left, (4, 1))]
    )
    edges, shares = fall_shares(impulses, np.array([0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0], float))
    assert edges.tolist() == [0.0, 35.0, 65.0]
    assert shares.shape == (DIRECTIONS, 2)
    assert shares[0].tolist() == [0.0, 1.0]
    assert np.isnan(shares[2, 0])
    assert shares[2, 1] == 0.5
    assert np.isnan(np.delete(shares, (0, 2), axis=0)).all()


@pytest.mark.parametrize(("angle", "sector"), [(0.3, 0), (-0.3, 0), (0.5, 1), (-0.5, DIRECTIONS - 1), (np.pi, 4)])
def test_a_sector_is_about_its_direction(angle, sector) -> None:
    impulses = np.tile([30 * np.cos(angle), 30 * np.sin(angle)], (3, 1))
    _, shares = fall_shares(impulses, np.ones(3))
    assert np.flatnonzero(np.isfinite(shares[:, 0])).tolist() == [sector]


def test_plots_are_small_svg_images() -> None:
    impulses = np.random.default_rng(0).normal(0.0, 30.0, (200, 2))
    contact = np.random.default_rng(0).random((200, 4)) > 0.5
    for drawn in (
        push_plot(impulses, np.ones(200), "trot"),
        gait_diagram(SIMPLE_QUAD, contact, 2.0, 0.01, "#000000", "a_rather_long_name/of/a/policy"),
    ):
        assert b"<svg" in drawn[:500]
        assert len(drawn) < 200_000
