"""What the report's plots are drawn from."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from evaluate.analysis.score import Score
from evaluate.commands.outputs import analysed
from evaluate.measures.footfalls import stances
from evaluate.records.store import read_run
from evaluate.report.page import render
from evaluate.report.plots import curves, drawing, success
from evaluate.report.sections.gait_section import gait_diagram
from evaluate.report.sections.push_section import DIRECTIONS, fall_shares, push_plot
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


LONG = "models/residual-with-a-long-name/seed-12"
WIDE = "W" * 30


@pytest.fixture
def clipped(monkeypatch) -> list[str]:
    """What reaches beyond its figure, of every figure that is saved meanwhile; how many there were stands first."""
    seen = ["0"]
    save = Figure.savefig

    def look(figure: Figure, *args, **settings) -> None:
        FigureCanvasAgg(figure)
        figure.draw_without_rendering()
        box = figure.get_tightbbox()
        beyond = np.maximum(0.0, [-box.x0, -box.y0, *(np.array([box.x1, box.y1]) - figure.get_size_inches())])
        if beyond.max() > 0.005:
            labels = [f"{axes.get_title('left')} {axes.get_xlabel()} {axes.get_ylabel()}" for axes in figure.axes]
            seen.append(f"{'; '.join(labels)}: {beyond.round(3)} in")
        seen[0] = str(int(seen[0]) + 1)
        save(figure, *args, **settings)

    monkeypatch.setattr(Figure, "savefig", look)
    return seen


def test_no_label_of_the_page_is_clipped(run, clipped) -> None:
    render(analysed(read_run(run.folder)), Path())
    assert clipped == ["17"]


def test_no_label_of_made_up_curves_is_clipped(made, clipped, tmp_path) -> None:
    render(made, Path())
    curves.write_falls(made, tmp_path / "curves.svg")
    assert len(clipped) == 1
    assert int(clipped[0]) > 8


@pytest.mark.parametrize("name", [LONG, WIDE])
def test_no_name_is_clipped(made_up_cell, clipped, name) -> None:
    from evaluate.analysis.results import analyse

    cells = [made_up_cell(policy, np.arange(9) < 3, np.linspace(0.1, 2.0, 9)) for policy in (name, "trot")]
    results = analyse(cells, seed=0, episodes=9, complete=True)
    impulses = np.outer(np.linspace(20.0, 220.0, 40), (1.0, 0.5))
    with drawing.settings():
        curves.intervals(results, "flat", "velocity_error", "velocity error, m/s")
        push_plot(impulses, np.ones(40), name)
        gait_diagram(SIMPLE_QUAD, np.ones((200, 4), bool), 3.0, 0.01, "#000000", name)
    assert clipped == ["3"]


def score(policy: str, **axes: int) -> Score:
    """A score on axes with so many severities."""
    rates = {axis: (0.5,) * severities for axis, severities in axes.items()}
    return Score(policy, 0.5, (0.4, 0.6), rates, 0.0, (0.0, 0.0), 1.0)


@pytest.mark.parametrize("severities", [1, 3])
@pytest.mark.parametrize(
    "names", [("trot",), ("document_repaired", "trot", "trot_feedback", "residual"), (LONG, WIDE, "trot", LONG + "0")]
)
def test_headings_of_the_heat_map_neither_overlap_nor_leave_it(clipped, names, severities) -> None:
    """Also where each axis has one severity, and a block of cells is narrower than a policy's name."""
    with drawing.settings():
        drawn = success.heat_map([score(name, flat=1, push=severities) for name in names])
        drawing.svg(drawn)
        FigureCanvasAgg(drawn)
        drawn.draw_without_rendering()
        boxes = [text.get_window_extent() for text in drawn.axes[0].texts]
    assert clipped == ["1"]
    assert not [(a, b) for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]
    assert [text.get_text().replace("\n", "") for text in drawn.axes[0].texts if not text.get_text().isdigit()] == list(
        names
    )


def test_a_policys_colour_is_its_own_whatever_the_order_and_company() -> None:
    names = ("document", "document_repaired", "trot", "residual", "trot_feedback", "mine", "models/run/best")
    alone = {name: drawing.styles(frozenset({name}))[name][0] for name in names}
    assert len(set(alone.values())) == len(names)
    for company in itertools.combinations(names, 3):
        assert {name: colour for name, (colour, _) in drawing.styles(frozenset(company)).items()} == {
            name: alone[name] for name in company
        }


def test_many_policies_are_all_told_apart() -> None:
    found = drawing.styles(frozenset(f"run-{number}" for number in range(9)))
    assert len({colour for colour, _ in found.values()}) == 9
    assert len(set(drawing.styles(frozenset(f"run-{number}" for number in range(40))).values())) == 40
