"""Impossible requests to the commands of the live package give one line, and nothing is written."""

from pathlib import Path

import pytest

from live.ros import interpreter
from live.view.requests import MAX_SEED
from quad_env.__main__ import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("film film.avi", "the film must end in .mp4, .webp, .gif, .png, not 'film.avi'"),
        ("film film.gif --policies", "--policies must name 1 to 9, not 0"),
        ("film film.gif --scenario push:all", "--scenario: push:all is 8 scenarios: name one of them"),
        ("film film.gif --size 640 9", "--size must be from 64 to 4096, not (640, 9)"),
        ("film mine.mcap/film.gif", "cannot write to the folder mine.mcap"),
        ("film film.gif --seconds 9000", "write an .mp4, or film less"),
        ("record mine.mcap", "exists already"),
        ("record walk", "an MCAP file, such as walk.mcap"),
        ("record walk.mcap --policy trott", "trott"),
        ("record walk.mcap --scenario push:all", "name one of them"),
        ("record walk.mcap --seconds nan", "--seconds must be"),
        ("record walk.mcap --command nan 0 0", "--command must be"),
        ("doctor --robot nobody", "unknown robot 'nobody'; there are simple_quad, "),
        ("doctor --robot nowhere.xml", "nowhere.xml is no file"),
        ("doctor --policy trott", "name one of behaviour, "),
        ("ros --scenario push:all", "name one of them"),
        ("ros --real-time-factor 0", "--real-time-factor must be"),
        (f"view --seed {MAX_SEED + 1}", "--seed"),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_written(words: str, said: str, tmp_path: Path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(interpreter, "REQUIRED_MODULES", {"1": ("json",)})
    Path("mine.mcap").write_text("mine", encoding="utf-8")
    assert said in refused(main, *words.split())
    assert [path.read_text(encoding="utf-8") for path in tmp_path.iterdir()] == ["mine"]
