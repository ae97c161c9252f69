"""Learning curves: validations of runs from their folders, seeds of one configuration pooled, and the figure."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluate.analysis.learning_curves import RunCurve, SeedBand, group_by_seed, read_curve
from evaluate.report.plots.drawing import COLOURS
from quad_env.cli.command_line import UsageError
from research.training.curves import draw_bands
from train.config import TrainConfig
from train.learning_curve import write_figure
from train.run_folder import CONFIG_FILE, VALIDATIONS_FILE
from train.run_record import to_dict

Points = list[tuple[int, float, float | None]]


def folder_of_run(folder: Path, points: Points | None, **settings: Any) -> Path:
    """Create a run's folder from steps, success and cost of transport of its validations, and changed settings."""
    folder.mkdir()
    (folder / CONFIG_FILE).write_text(json.dumps(to_dict(TrainConfig()) | settings))
    names = "steps", "success", "cost_of_transport"
    if points is not None:
        entries = [dict(zip(names, point, strict=True)) for point in points]
        (folder / VALIDATIONS_FILE).write_text(json.dumps({"best": 0, "validations": entries}))
    return folder


def test_runs_that_differ_in_their_seed_alone_are_one_band_over_the_seeds(tmp_path: Path) -> None:
    a = folder_of_run(tmp_path / "a", [(100, 0.2, 1.0), (200, 0.6, 0.8)], seed=0)
    b = folder_of_run(tmp_path / "b", [(100, 0.4, 2.0), (200, 0.4, 0.6), (300, 0.9, 0.5)], seed=1)
    c = folder_of_run(tmp_path / "c", [(100, 0.5, 3.0)], seed=0, base="trot")
    band, other = group_by_seed([read_curve(each) for each in (a, b, c)])
    assert [run.folder for run in band.runs] == [a, b]
    np.testing.assert_array_equal(band.steps, [100, 200])  # steps at which both runs were validated
    mean, low, high = band.over_seeds()
    np.testing.assert_allclose(mean, [[0.3, 0.5], [1.5, 0.7]])
    np.testing.assert_allclose(low, [[0.2, 0.4], [1.0, 0.6]])
    np.testing.assert_allclose(high, [[0.4, 0.6], [2.0, 0.8]])
    assert [band.label, other.label] == ["base trot_reference (2 seeds)", "base trot (seed 0)"]
    np.testing.assert_allclose(other.over_seeds()[0], [[0.5], [3.0]])


def test_a_recipe_of_many_words_goes_by_its_first_folder(tmp_path: Path) -> None:
    a, b = (folder_of_run(tmp_path / name, [(1, 0.5, 1.0)], steps=number) for name, number in (("a", 1), ("b", 10**60)))
    assert [each.label for each in group_by_seed([read_curve(a), read_curve(b)])] == [
        "steps 1 (seed 0)",
        f"{b} (seed 0)",
    ]


def test_one_seed_given_twice_is_no_band(tmp_path: Path) -> None:
    curves = [read_curve(folder_of_run(tmp_path / name, [(1, 0.5, 1.0)], seed=4)) for name in ("a", "b")]
    with pytest.raises(UsageError, match="both seed 4 of one recipe"):
        group_by_seed(curves)


def test_an_older_run_has_no_cost_of_transport_and_settings_of_its_own(tmp_path: Path) -> None:
    older = folder_of_run(tmp_path / "older", [(5, 0.5, None)], space="footholds")
    entries = json.loads((older / VALIDATIONS_FILE).read_text())
    del entries["validations"][0]["cost_of_transport"]
    (older / VALIDATIONS_FILE).write_text(json.dumps(entries))
    curve = read_curve(older)
    assert curve.settings["space"] == "footholds"
    np.testing.assert_array_equal(curve.figures, [[0.5], [np.nan]])


def test_a_run_without_a_validation_is_an_empty_curve(tmp_path: Path) -> None:
    assert len(read_curve(folder_of_run(tmp_path / "new", None)).steps) == 0


@pytest.mark.parametrize("content", ["", "[]", '{"validations": [3]}', '{"validations": [{"steps": 1}]}', "{}"])
def test_damaged_validations_are_one_line_that_names_the_file(content: str, tmp_path: Path) -> None:
    folder = folder_of_run(tmp_path / "run", [])
    (folder / VALIDATIONS_FILE).write_text(content)
    with pytest.raises(UsageError, match=r"validations.json holds no validations of a training run"):
        read_curve(folder)


STEPS = np.array([1e6, 2e6])


def run(seed: int, success: tuple[float, float], cost: tuple[float, float] = (1.0, 1.0)) -> RunCurve:
    return RunCurve(Path(f"run-{seed}"), {}, seed, STEPS, np.array([success, cost]))


TWO = SeedBand("two seeds", (run(0, (0.2, 0.6), (1.0, 2.0)), run(1, (0.4, 0.8), (3.0, 4.0))))
ONE = SeedBand("alone", (run(0, (0.9, 0.7)),))


def lines(axes: Any) -> dict[str, list[float]]:
    """Return the heights of the labelled lines."""
    named = {line.get_label(): line.get_ydata().tolist() for line in axes.get_lines()}
    return {name: heights for name, heights in named.items() if not str(name).startswith("_")}


def test_each_recipe_has_its_mean_and_a_band_from_the_lowest_seed_to_the_highest() -> None:
    success, cost = draw_bands([TWO, ONE]).axes
    assert lines(success) == {"two seeds": pytest.approx([30.0, 70.0]), "alone": pytest.approx([90.0, 70.0])}
    assert lines(cost) == {"two seeds": pytest.approx([2.0, 3.0]), "alone": [1.0, 1.0]}
    band, _ = (each.get_paths()[0].get_extents() for each in success.collections)
    assert (band.x0, band.x1) == (1e6, 2e6)
    assert (band.y0, band.y1) == (pytest.approx(20.0), pytest.approx(80.0))
    assert [line.get_color() for line in success.get_lines()] == [COLOURS[0]] * 3 + [COLOURS[1]]
    assert success.get_ylabel() == "success in validation, %"
    assert cost.get_xlabel().startswith("steps")
    assert [text.get_text() for text in success.figure.legends[0].get_texts()] == ["two seeds", "alone"]


def test_without_any_cost_of_transport_only_success_is_drawn() -> None:
    older = dataclasses.replace(ONE, runs=(run(0, (0.9, 0.7), (np.nan, np.nan)),))
    assert len(draw_bands([older]).axes) == 1
    assert len(draw_bands([older, TWO]).axes) == 2


@pytest.mark.parametrize(("suffix", "magic"), [(".svg", b"<?xml"), (".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_the_same_runs_give_the_same_file(suffix: str, magic: bytes, tmp_path: Path) -> None:
    first, second = (tmp_path / f"{name}{suffix}" for name in "ab")
    write_figure(lambda: draw_bands([ONE]), first)
    write_figure(lambda: draw_bands([ONE]), second)
    assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes().startswith(magic)
