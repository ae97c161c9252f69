"""Each command runs, prints what fits into a terminal and writes its figures; mistakes are one line and exit code 2."""

import importlib
import json
import shutil
from pathlib import Path

import pytest

from benchmarks.support.bars import check
from benchmarks.support.command import WIDTH, Outcome
from benchmarks.view import CHROMIUM

TOGETHER = ("single_env", "vector_env", "physics", "policies", "startup")
COMMANDS = (*TOGETHER, "rendering", "recording", "view")


def run(name: str, *arguments: object) -> int:
    code = importlib.import_module(f"benchmarks.{name}").main([str(argument) for argument in arguments])
    assert isinstance(code, int)
    return code


@pytest.fixture
def quick(tmp_path: Path, capsys):
    """Runs a command with --quick; the figures of its file."""

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


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("single_env", ""),
        ("physics", ""),
        ("policies", "--policies stand trot"),
        ("recording", "--policies trot"),
        ("startup", ""),
    ],
)
def test_command_prints_and_writes_its_figures(name: str, options: str, quick) -> None:
    assert quick(name, *options.split())


def test_vector_env_includes_a_share_of_a_reset(quick) -> None:
    found = quick("vector_env")
    del found["printed"]
    assert set(found) == {"flat 1", "flat 3", "rough 1", "rough 3"}
    assert all(each["reset_us"]["median"] > 0 for each in found.values())


@pytest.mark.rendering
def test_rendering_counts_frames_of_every_ground(quick) -> None:
    rates = quick("rendering")["frames_a_second"]
    assert all(rates[ground]["median"] > 0 for ground in ("flat", "stairs", "rough"))


def test_all_together_names_the_command_of_a_figure_that_it_does_not_measure(quick, monkeypatch) -> None:
    measured = Outcome({}, (), (check("single_env", 1.0),))
    for name in TOGETHER:
        monkeypatch.setattr(f"benchmarks.{name}.measure", lambda _: measured)
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


@pytest.mark.rendering
@pytest.mark.skipif(not any(map(shutil.which, CHROMIUM)), reason="needs a browser: apt-get install chromium")
def test_view_is_watched_by_a_browser(quick) -> None:
    found = quick("view")["view"]
    assert found["frames"] > 0.0
    assert found["real_time"] > 0.0
    assert 0.0 < found["first_frame"] < 60.0
