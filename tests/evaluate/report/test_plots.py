"""Data of the report's plots."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from evaluate.analysis.comparison import FALL_RATE, SUCCESS_RATE
from evaluate.analysis.pareto import ParetoPoint, find_pareto_front
from evaluate.analysis.results import Results, analyse
from evaluate.analysis.score import Score
from evaluate.analysis.severity_levels import SeverityAxis, severity_axes
from evaluate.report.plots import curves, drawing, pareto, success
from evaluate.rollouts.battery import resolve
from tests.evaluate.report.conftest import watch_clipping

LONG = "models/residual-with-a-long-name/seed-12"
WIDE = "W" * 30


@pytest.fixture
def clipped(monkeypatch) -> list[str]:
    return watch_clipping(monkeypatch)


def test_no_label_of_a_page_is_clipped(four) -> None:
    assert len(four.clipped) == 1
    assert int(four.clipped[0]) >= 4


def score(policy: str, **axes: int) -> Score:
    """Return a score on axes; `axes`: axis -> number of its severities."""
    rates = {axis: (0.5,) * severities for axis, severities in axes.items()}
    return Score(policy, 0.5, (0.4, 0.6), rates, 0.0, (0.0, 0.0), 1.0)


@pytest.mark.parametrize(
    ("names", "severities"),
    [
        (("trot",), 1),
        (("document_repaired", "trot", "trot_feedback", "residual"), 3),
        ((LONG, WIDE, "trot", LONG + "0"), 1),
    ],
)
def test_headings_of_the_heat_map_neither_overlap_nor_leave_it(clipped, names, severities) -> None:
    """The headings fit also if each axis has one severity and a block of cells is narrower than a policy's name."""
    with drawing.plot_settings():
        drawn = success.draw_heat_map([score(name, flat=1, push=severities) for name in names])
        drawing.figure_to_svg(drawn)
        FigureCanvasAgg(drawn)
        drawn.draw_without_rendering()
        boxes = [text.get_window_extent() for text in drawn.axes[0].texts]
    assert clipped == ["1"]
    assert not [(a, b) for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]
    assert [text.get_text().replace("\n", "") for text in drawn.axes[0].texts if not text.get_text().isdigit()] == list(
        names
    )


@pytest.mark.parametrize("count", [1, 2, 12])
def test_the_front_shows_every_policy_that_goes_somewhere(clipped, count) -> None:
    """Names of twelve policies neither overlap nor leave the figure."""
    names = (*(f"models/residual/seed-{number}" for number in range(count)), "stand")
    share = np.linspace(0.2, 0.9, count)
    cost = np.where(np.arange(count) % 2, 1.0 + share, 2.0 + share)
    points = [
        ParetoPoint(name, s, (s - 0.1, s + 0.1), c, (c - 0.1, np.inf))
        for name, s, c in zip(names, (*share, 0.0), (*cost, np.nan), strict=True)
    ]
    found = find_pareto_front("steady", points)
    with drawing.plot_settings():
        drawn = pareto.draw_pareto_front(found, names)
        drawing.figure_to_svg(drawn)
        FigureCanvasAgg(drawn)
        drawn.draw_without_rendering()
        (legend,) = drawn.legends
        boxes = [each.get_window_extent() for each in (*legend.get_texts(), drawn.axes[0].xaxis.label)]
    assert clipped == ["1"]
    assert not [(a, b) for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]
    assert len(legend.get_texts()) == count


def test_a_policys_colour_is_its_own_and_many_are_all_told_apart() -> None:
    alone = {name: drawing.styles((name,))[name] for name in drawing.FIXED_STYLE_POLICIES}
    assert len({colour for colour, _ in alone.values()}) == len(drawing.FIXED_STYLE_POLICIES)
    assert drawing.styles((*drawing.FIXED_STYLE_POLICIES[::-1], "mine")).items() > alone.items()
    found = drawing.styles(("trot", *(f"run-{number}" for number in range(40))))
    assert len(set(found.values())) == 41


def test_a_figure_is_written_again_after_its_file_was_deleted(tmp_path: Path) -> None:
    out = tmp_path / "plot.png"

    def draw() -> Figure:
        return drawing.make_figure(1.0)[0]

    drawing.write_image(draw, out, 50)
    content = out.read_bytes()
    out.unlink()
    drawing.write_image(draw, out, 50)
    assert out.read_bytes() == content


def against_push(made_up_cell, *names: str) -> tuple[Results, SeverityAxis]:
    """Return cells of policies that succeed in the same episodes, up to half of the axis."""
    cells = [
        made_up_cell(name, np.arange(16) < falls, None, scenario)
        for scenario, falls in zip(resolve(("push:1", "push:2", "push:3", "push:4")), (0, 0, 16, 16), strict=True)
        for name in names
    ]
    results = analyse(cells, seed=0, episodes=16, complete=True)
    (axis,) = severity_axes(results.cells)
    return results, axis


@pytest.mark.parametrize("names", [("trot", "residual"), (*drawing.FIXED_STYLE_POLICIES, LONG, "b")])
def test_curves_that_agree_do_not_hide_each_other(made_up_cell, names) -> None:
    """The number of pixels in a policy's colour is compared between a plot of this policy alone and a plot of all."""
    results, axis = against_push(made_up_cell, *names)
    with drawing.plot_settings():
        whole = curves.draw_severity_curves(results, axis, FALL_RATE, "falls")
        for legend in whole.legends:
            legend.remove()
        canvas = FigureCanvasAgg(whole)
        canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    for policy in names:
        colour = np.array([int(drawing.style(results, policy)[0][k : k + 2], 16) for k in (1, 3, 5)])
        own = (np.abs(pixels - colour).max(axis=-1) < 12).sum()
        assert own > 40, policy


def test_a_plot_of_an_axis_names_every_policy_that_ran_on_it(made_up_cell, clipped) -> None:
    names = (*drawing.FIXED_STYLE_POLICIES, LONG, WIDE)
    results, axis = against_push(made_up_cell, *names)
    with drawing.plot_settings():
        drawn = curves.draw_severity_curves(results, axis, SUCCESS_RATE, "success")
        drawing.figure_to_svg(drawn)
        FigureCanvasAgg(drawn)
        drawn.draw_without_rendering()
        (legend,) = drawn.legends
        boxes = [each.get_window_extent() for each in (*legend.get_texts(), drawn.axes[0].xaxis.label)]
    assert [each.get_text() for each in legend.get_texts()] == [drawing.short_name(name) for name in names]
    assert clipped == ["1"]
    assert not [(a, b) for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]


def test_a_long_name_is_cut_at_the_start_of_a_word() -> None:
    assert drawing.short_name("/home/someone/policies/own.py:MyPolicy") == "…own.py:MyPolicy"
    assert drawing.short_name(WIDE).startswith("…W")
