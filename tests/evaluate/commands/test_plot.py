"""`python -m evaluate plot`: sizes, contents and intervals of the figures for papers."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from evaluate.__main__ import main
from evaluate.analysis.entries import list_entries
from evaluate.analysis.learning_curves import group_by_seed, read_curve
from evaluate.analysis.results import analyse
from evaluate.analysis.severity_levels import severity_axes
from evaluate.commands.stored_results import load_results
from evaluate.report.plots import paper
from evaluate.rollouts.battery import resolve
from tests.evaluate.conftest import MEMBERS, fallen


@pytest.fixture(scope="module")
def results(planted_run):
    return load_results(planted_run)


@pytest.fixture
def trainings(tmp_path: Path) -> list[Path]:
    """Return the folders of three training seeds of one recipe, and of one seed of another."""
    folders = []
    for name, seed, base, gain in (
        ("a0", 0, "trot", 0.2),
        ("a1", 1, "trot", 0.3),
        ("a2", 2, "trot", 0.5),
        ("b", 0, "mpc", 0.4),
    ):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "config.json").write_text(json.dumps({"policy": "residual", "base": base, "seed": seed}))
        points = [
            {"steps": 100_000 * k, "success": min(1.0, gain * k / 2), "cost_of_transport": 2.0 - 0.1 * k * gain}
            for k in range(1, 5)
        ]
        (folder / "validations.json").write_text(json.dumps({"validations": points}))
        folders.append(folder)
    return folders


@pytest.mark.parametrize("kind", ["scores", "axes", "pareto"])
@pytest.mark.parametrize("columns", [1, 2])
def test_a_vector_figure_has_the_width_of_its_columns(planted_run, tmp_path, capsys, kind, columns) -> None:
    out = tmp_path / f"{kind}.pdf"
    assert main(["plot", str(planted_run), "--kind", kind, "--columns", str(columns), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    content = out.read_bytes()
    assert content.startswith(b"%PDF")
    assert b"/Subtype /Image" not in content
    (box,) = re.findall(rb"/MediaBox \[ ?0 0 ([\d.]+) [\d.]+ ?\]", content)
    assert float(box) / 72 == pytest.approx(paper.WIDTHS[columns], abs=0.01)
    assert b"/FontFile2" in content  # TrueType, as publishers demand; Type 3 fonts have none.


def test_equal_runs_give_equal_files_and_svg_keeps_its_text(planted_run, tmp_path) -> None:
    for name in ("a.svg", "b.svg"):
        assert main(["plot", str(planted_run), "--kind", "axes", "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert "mine (3 seeds)" in (tmp_path / "a.svg").read_text(encoding="utf-8")


def test_policies_select_and_order_the_entries(planted_run, tmp_path) -> None:
    words = ["--kind", "axes", "--policies", "stand", "mine", "--out", str(tmp_path / "a.svg")]
    assert main(["plot", str(planted_run), *words]) == 0
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "trot" not in text
    assert text.index(">stand<") < text.index(">mine (3 seeds)<")


def segments(axes) -> list[np.ndarray]:
    """Return both ends of every error bar of a panel."""
    return [segment for lines in axes.collections for segment in lines.get_segments()]


def test_scores_show_every_entry_with_its_interval_and_the_interquartile_mean_of_a_group(results) -> None:
    entries = list_entries(results)
    figure = paper.draw_scores(entries, 2)
    score_panel, hardware_panel = figure.axes
    ends = {tuple(np.round(np.sort(segment[:, 0]), 6)) for segment in segments(score_panel)}
    for entry in entries:
        assert tuple(np.round(100 * np.array(entry.score.ci), 6)) in ends
    (mine,) = (entry for entry in entries if entry.is_group)
    assert tuple(np.round(100 * np.array(mine.interquartile_mean.ci), 6)) in ends
    labels = [text.get_text() for text in score_panel.get_yticklabels()]
    assert labels == ["trot", "mine (3 seeds)", "stand"]
    assert len(segments(hardware_panel)) == len(entries) + 1
    assert not {*MEMBERS} & {*labels}


def test_axes_show_the_rates_of_each_entry_and_the_ends_of_their_intervals(results) -> None:
    entries = list_entries(results)
    axes = [axis for axis in severity_axes(results.cells) if len(axis.levels) > 1]
    figure = paper.draw_axes(axes, entries, 1)
    assert [panel.get_title(loc="left") for panel in figure.axes] == ["push", "slope"]
    panel = figure.axes[0]
    lines = {line.get_label(): line for line in panel.get_lines()}
    for index, entry in enumerate(entries):
        rates = [100 * entry.success[level.name].value for level in axes[0].levels]
        label = "mine (3 seeds)" if entry.is_group else entry.name
        np.testing.assert_allclose(lines[label].get_ydata(), rates)
        band = panel.collections[index].get_paths()[0].vertices[:, 1]
        ends = 100 * np.array([entry.success[level.name].ci for level in axes[0].levels])
        assert (band.min(), band.max()) == pytest.approx((ends.min(), ends.max()))
    assert panel.get_xlabel().endswith("N·s")


def test_the_pareto_figure_has_a_point_for_each_entry_and_not_for_its_training_seeds(results) -> None:
    figure = paper.draw_pareto(list_entries(results), "flat", 1)
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert sorted(labels) == ["mine (3 seeds)", "stand", "trot"]


def test_learning_curves_show_the_mean_of_the_seeds_and_students_interval(trainings) -> None:
    bands = group_by_seed([read_curve(folder) for folder in trainings])
    figure = paper.draw_learning_curves(bands, 2)
    panel = figure.axes[0]
    (mean,) = (line for line in panel.get_lines() if line.get_label() == "base trot (3 seeds)")
    values = np.array([[min(1.0, gain * k / 2) for k in range(1, 5)] for gain in (0.2, 0.3, 0.5)])
    np.testing.assert_allclose(mean.get_ydata(), 100 * values.mean(axis=0))
    half = scipy.stats.t.ppf(0.975, 2) * scipy.stats.sem(values, axis=0)
    band = panel.collections[0].get_paths()[0].vertices
    for step, middle, width in zip(100_000 * np.arange(1, 5), values.mean(axis=0), half, strict=True):
        heights = band[band[:, 0] == step, 1]
        low, high = 100 * max(0.0, middle - width), 100 * min(1.0, middle + width)
        assert (heights.min(), heights.max()) == pytest.approx((low, high))
    assert len(panel.collections) == 1  # One seed has no interval.


def test_the_command_draws_learning_curves_and_prints_the_last_point_with_its_interval(
    trainings, tmp_path, capsys
) -> None:
    out = tmp_path / "curves.pdf"
    assert main(["plot", *map(str, trainings), "--kind", "curves", "--out", str(out)]) == 0
    printed = capsys.readouterr().out.replace("\u00a0", " ").splitlines()
    assert re.fullmatch(r"base trot \(3 seeds\): success 67 % \[0, 100\] after 400000 steps", printed[0]), printed
    assert out.read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("RUN --out a.bmp", "--out: unknown format, got a.bmp; valid: .pdf, .svg, .png"),
        ("RUN RUN --kind scores", "--kind scores: one results folder, got 2"),
        ("RUN --policies hop", "--policies: not in this run, got hop; valid: trot, stand, mine"),
        ("RUN --kind curves", "no run in RUN: config.json cannot be read"),
        ("RUN --kind curves --policies trot", "--policies: selects policies of an evaluation"),
    ],
)
def test_bad_input_is_one_line(planted_run, tmp_path, monkeypatch, capsys, words, complaint) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["plot", *words.replace("RUN", str(planted_run)).split()]) == 2
    assert complaint.replace("RUN", str(planted_run)) in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("columns", [1, 2])
def test_labels_of_neighbouring_panels_do_not_overlap(results, columns) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    names = ("latency", "noise", "dropout", "surprise")
    scenarios = resolve(tuple(f"{name}:all" for name in names))
    cells = [fallen("trot", scenario.name, 3, np.zeros(8)) for scenario in scenarios]
    entry = list_entries(analyse(cells, seed=0, episodes=8, complete=True))
    with paper.paper_settings():
        figure = paper.draw_axes(severity_axes(cells), entry, columns)
        FigureCanvasAgg(figure).draw()
    boxes = [panel.xaxis.label.get_window_extent() for panel in figure.axes]
    across = paper.AXES_PER_ROW[columns]
    for index, box in enumerate(boxes):
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1
        if (index + 1) % across:
            assert box.x1 < boxes[index + 1].x0
