"""Mutated files of every format give a result or one line, for fixed seeds; `python -m research fuzz` runs more."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from policies.base import PolicyError
from research.fuzzing import run, writers
from research.fuzzing.formats import FORMATS
from research.fuzzing.mutations import list_entries, mutate_bytes, mutate_tree
from research.fuzzing.readers import AbsurdError
from research.fuzzing.run import READ, REFUSED, FuzzOptions, main, run_case

pytest.importorskip("yaml")
pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

CASES = {"mjcf": 15, "urdf": 15, "bundle": 20, "onnx": 20, "mjlab": 30}
"""Format -> number of cases, for formats that take longer than others."""


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.filterwarnings("ignore")
def test_a_mutated_file_is_read_or_refused_in_one_line(name: str) -> None:
    results = [run_case(name, seed=1, number=number) for number in range(CASES.get(name, 40))]
    assert [each for each in results if each.kind not in (READ, REFUSED)] == []
    assert REFUSED in {each.kind for each in results}


@pytest.mark.parametrize("name", FORMATS)
def test_the_file_that_is_mutated_is_read(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise every mutation would be refused for a reason of the original file."""
    monkeypatch.setattr(writers, "mutate_tree", lambda tree, *_: tree)
    monkeypatch.setattr(writers, "mutate_xml", lambda tree, *_: tree)
    monkeypatch.setattr(writers, "mutate_bytes", lambda content, *_: content)
    monkeypatch.setattr(writers, "_change_count", lambda _: 0)
    write, read = FORMATS[name]
    file = write(tmp_path, np.random.default_rng(0))
    if name == "sb3":
        with pytest.raises(PolicyError, match="can run code"):
            read(file)
    else:
        read(file)


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (KeyError("x"), "traceback"),
        (AbsurdError("a robot of -1 kg"), "absurd"),
        (PolicyError("two\nlines"), "not one line"),
        (PolicyError("one line"), REFUSED),
    ],
)
def test_what_is_looked_for_is_found(fault: Exception, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Path) -> None:
        raise fault

    monkeypatch.setitem(FORMATS, "toml", (FORMATS["toml"][0], fail))
    assert run_case("toml", 0, 0).kind == kind


def test_a_library_that_raises_a_value_error_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(FORMATS, "toml", (FORMATS["toml"][0], lambda _: np.stack([np.zeros(2), np.zeros(3)])))
    assert run_case("toml", 0, 0).kind == "traceback"


class _Process:
    """Replacement of the process that runs a case."""

    pid = 0


class _Silent:
    """Replacement of a connection without an answer."""

    def poll(self, _: float) -> bool:
        return False


def test_a_case_without_an_end_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "HANG_TIME", 0.05)
    with pytest.raises(TimeoutError):
        run._receive_result(_Silent(), _Process())  # type: ignore[arg-type]


def test_mutations_are_the_same_for_a_number_and_leave_the_original(tmp_path: Path) -> None:
    tree = {"a": [1, 2, {"b": "c"}], "d": 1.0}
    text = json.dumps(tree)
    made = [json.dumps(mutate_tree(tree, np.random.default_rng(n), 2), default=str) for n in range(30)]
    assert made == [json.dumps(mutate_tree(tree, np.random.default_rng(n), 2), default=str) for n in range(30)]
    assert len(set(made)) > 20
    assert json.dumps(tree) == text
    assert len(list_entries(tree)) == 6
    assert len({mutate_bytes(b"some bytes", np.random.default_rng(n)) for n in range(20)}) > 10


def test_the_command_runs_cases_in_a_process_apart_and_sums_up(repository: Path) -> None:
    command = [sys.executable, "-m", "research", "fuzz", "terrain", "--cases", "5", "--minutes", "5"]
    ended = subprocess.run(command, cwd=repository, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.startswith("terrain: 5 cases: ")


def test_an_unknown_format_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(run.UsageError, match="unknown format, got pdf; valid: legged-gym-yaml, "):
        main(FuzzOptions("pdf"))
    began = time.monotonic()
    assert main(FuzzOptions("list")) == 0
    assert capsys.readouterr().out.split() == list(FORMATS)
    assert time.monotonic() - began < 60
