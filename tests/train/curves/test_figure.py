"""The picture of learning curves: what it shows is what the runs have."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluate.report.plots.drawing import COLOURS
from train.learning_curves import RunCurve, SeedBand, draw, write_picture

STEPS = np.array([1e6, 2e6])


def run(seed: int, success: tuple[float, float], cost: tuple[float, float] = (1.0, 1.0)) -> RunCurve:
    return RunCurve(Path(f"run-{seed}"), {}, seed, STEPS, np.array([success, cost]))


TWO = SeedBand("two seeds", (run(0, (0.2, 0.6), (1.0, 2.0)), run(1, (0.4, 0.8), (3.0, 4.0))))
ONE = SeedBand("alone", (run(0, (0.9, 0.7)),))


def lines(axes: Any) -> dict[str, list[float]]:
    """Heights of the labelled lines."""
    named = {line.get_label(): line.get_ydata().tolist() for line in axes.get_lines()}
    return {name: heights for name, heights in named.items() if not str(name).startswith("_")}


def test_each_recipe_has_its_mean_and_a_band_from_the_lowest_seed_to_the_highest() -> None:
    success, cost = draw([TWO, ONE]).axes
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
    assert len(draw([older]).axes) == 1
    assert len(draw([older, TWO]).axes) == 2


@pytest.mark.parametrize(("suffix", "magic"), [(".svg", b"<?xml"), (".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_the_same_runs_give_the_same_file(suffix: str, magic: bytes, tmp_path: Path) -> None:
    first, second = (tmp_path / f"{name}{suffix}" for name in "ab")
    write_picture([ONE], first)
    write_picture([ONE], second)
    assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes().startswith(magic)
