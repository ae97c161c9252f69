"""Each benchmark runs, prints a table that fits into a terminal, and writes its numbers; user errors are one line."""

import importlib
import json
import shutil
from pathlib import Path

import pytest

from benchmarks.support.bars import check_requirement
from benchmarks.support.command import WIDTH, BenchmarkResult
from benchmarks.view import CHROMIUM

TOGETHER = ("single_env", "vector_env", "physics", "policies", "network", "startup")
COMMANDS = (*TOGETHER, "evaluation", "rendering", "recording", "view")


def run(name: str, *arguments: object) -> int:
    code = importlib.import_module(f"benchmarks.{name}").main([str(argument) for argument in arguments])
    assert isinstance(code, int)
    return code


@pytest.fixture
def quick(tmp_path: Path, capsys):
    """Return a function that runs a command with --quick and returns the numbers of its file."""

    def figures(name: str, *options: str) -> dict:
        path = tmp_path / "kept.json"
        assert run(name, "--quick", "--json", path, *options) == 0
        printed = capsys.readouterr().out
        table_lines = [line for line in printed.splitlines() if line.startswith(("│", "┃"))]
        assert table_lines
        assert max(map(len, table_lines)) <= WIDTH
        record = json.loads(path.read_text(encoding="utf-8"))
        assert record["machine"]["mujoco"] in printed
        return record["figures"] | {"printed": printed}

    return figures


BROWSER = pytest.mark.skipif(not any(map(shutil.which, CHROMIUM)), reason="needs a browser: apt-get install chromium")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("single_env", ""),
        ("vector_env", ""),
        ("physics", ""),
        ("policies", "--policies stand trot"),
        ("network", "--hidden 8 4"),
        ("recording", "--policies trot"),
        ("evaluation", ""),
        ("startup", ""),
        pytest.param("rendering", "", marks=pytest.mark.rendering),
        pytest.param("view", "", marks=[pytest.mark.rendering, BROWSER]),
    ],
)
def test_command_prints_and_writes_its_figures(name: str, options: str, quick) -> None:
    found = quick(name, *options.split())
    if name == "vector_env":
        assert found.keys() == {"flat 1", "flat 3", "rough 1", "rough 3", "printed"}
        assert all(found[each]["reset_us"]["median"] > 0 for each in found.keys() - {"printed"})
    if name == "network":
        assert found["seconds_per_robot_step"].keys() == found["ratio"].keys() == {"1", "2"}
        assert all(ratio["median"] > 0.0 for ratios in found["ratio"].values() for ratio in ratios.values())
    if name == "rendering":
        assert all(found["frames_a_second"][ground]["median"] > 0 for ground in ("flat", "stairs", "rough"))
    if name == "view":
        assert 0.0 < found["view"]["first_frame"] < 60.0
        assert min(found["view"]["frames"], found["view"]["real_time"]) > 0.0


def test_all_together_names_the_command_of_a_figure_that_it_does_not_measure(quick, monkeypatch) -> None:
    measured = BenchmarkResult({}, (), (check_requirement("single_env", 1.0),))
    for name in TOGETHER:
        monkeypatch.setattr(importlib.import_module(f"benchmarks.{name}"), "measure", lambda _: measured)
    found = quick("__main__")
    assert set(found) == {*TOGETHER, "printed"}
    assert all(f"python -m benchmarks.{name}" in found["printed"] for name in COMMANDS[len(TOGETHER) :])


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("single_env", ["--steps", "0"], "--steps must be from 1 to 1000"),
        ("vector_env", ["--envs", "2", "2"], "twice"),
        ("vector_env", ["--scenarios", "ice"], "valid: flat, push, rough"),
        ("physics", ["--settings", "fast"], "valid: shipped"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(name: str, arguments: list[str], words: str, refused) -> None:
    assert words in refused(importlib.import_module(f"benchmarks.{name}").main, *arguments)
