"""A run that is killed or stopped by an error continues with --resume, with the results of an uninterrupted run."""

import contextlib
import io
import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from evaluate.__main__ import main
from evaluate.analysis.results import Results, results_to_json
from evaluate.cells import EpisodeChunk
from evaluate.records import manifest, provenance, store
from evaluate.records.episode_table import cell_of, read_table, table, write_table
from evaluate.records.store import FILES
from evaluate.rollouts import rollout
from quad_env.files.writing import write_atomically
from tests.seams import full_disk, replace_report, replace_simulation

STEPS = 150
RUN = ("--policies", "stand", "trot", "--scenarios", "flat", "push:4", "--episodes", "5", "--seed", "2")
PARTS = 2 * 2 * 3
"""Number of parts with two episodes each."""
OUTCOME = ("results.json", "episodes.parquet", "report.html", "manifest.json")

SHORT = """
import os, signal, sys
from evaluate.rollouts import rollout
from evaluate.__main__ import main
from quad_env.files import writing as files
from evaluate.commands import outputs as ending
from evaluate.analysis.results import results_to_json
rollout.STEPS = int(sys.argv[1])
ending.write_report = lambda found, path, **_: files.write_atomically(path, repr(results_to_json(found)).encode())
left = int(sys.argv[2])
class Dying(type(files.Path())):
    def replace(self, target):
        global left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().replace(target)
files.Path = Dying
raise SystemExit(main(sys.argv[3:]))
"""
"""Program that runs the command with short episodes and is killed just before the file of a given index is complete."""


def a_page(results: Results, path: Path, **_options) -> None:
    """Write a short text instead of the report, because its plots take a second."""
    write_atomically(path, repr(results_to_json(results)).encode())


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rollout, "STEPS", STEPS)
    replace_report(monkeypatch, a_page)


def evaluate(*arguments: object) -> tuple[int, str]:
    """Return exit code and stderr."""
    error = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(error):
        code = main([str(argument) for argument in arguments])
    return code, error.getvalue()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an uninterrupted run."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "STEPS", STEPS)
        replace_report(patch, a_page)
        assert evaluate(*RUN, "--out", folder)[0] == 0
    return folder


def assert_same(folder: Path, whole: Path) -> None:
    assert {path.name for path in folder.iterdir()} == {*FILES}
    for name in OUTCOME:
        assert (folder / name).read_bytes() == (whole / name).read_bytes(), name


def killed(repository: Path, folder: Path, write: int) -> None:
    command = [sys.executable, "-c", SHORT, str(STEPS), str(write), *RUN, "--at-once", "2", "--out", str(folder)]
    finished = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False)
    assert finished.returncode == -signal.SIGKILL, finished.stderr


# The first write is a part; then come the manifest, the other parts, results.json, episodes.parquet and report.html.
@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
@pytest.mark.parametrize("write", [3, PARTS + 2])
def test_a_killed_run_goes_on_to_the_same_files(repository, tmp_path, whole, write) -> None:
    killed(repository, tmp_path, write)
    temporaries = [path for path in tmp_path.rglob(".*") if path.is_file()]
    assert temporaries, "it was not killed in the middle of a write"
    code, error = evaluate("--resume", "--out", tmp_path)
    assert code == 0, error
    assert_same(tmp_path, whole)


def unfinished(whole: Path, folder: Path) -> Path:
    """Create the folder of a killed run: two of four cells are complete, one of them in two parts."""
    shutil.copytree(whole, folder, dirs_exist_ok=True)
    run = store.read_run(folder)
    remove = [folder / name for name in OUTCOME[:3]]
    chunks = store.ChunkStore(folder, run.manifest)
    for cell, numbers in ((run.cells[0], range(5)), (run.cells[1], (0, 1)), (run.cells[1], (4,)), (run.cells[3], (2,))):
        chunks.save(EpisodeChunk(np.array(numbers), cell_of(table(cell).take([*numbers]), cell.scenario)))
    for path in remove:
        path.unlink()
    return folder


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that receives the number of episodes of each scenario of each rollout."""
    simulated: list[int] = []
    run = rollout.run_scenarios

    def noted(policy, batches, **options):
        simulated.extend(len(batch.seeds) for batch in batches)
        return run(policy, batches, **options)

    replace_simulation(monkeypatch, noted)
    return simulated


def test_parts_of_any_size_are_filled_up_and_nothing_is_simulated_twice(tmp_path, whole, monkeypatch) -> None:
    folder, simulated = unfinished(whole, tmp_path), counted(monkeypatch)
    assert evaluate(*RUN, "--at-once", "1", "--resume", "--threads", "1", "--out", folder)[0] == 0
    assert sum(simulated) == 20 - 9
    assert_same(tmp_path, whole)


def test_a_new_run_replaces_an_unfinished_one_and_leaves_foreign_files(tmp_path, whole) -> None:
    note = unfinished(whole, tmp_path) / "parts" / "note.txt"
    note.write_text("mine", encoding="utf-8")
    code, error = evaluate(*RUN, "--threads", "1", "--at-once", "3", "--out", tmp_path)
    assert (code, "--resume" in error.splitlines()[0]) == (0, True)
    assert [path.name for path in note.parent.iterdir()] == ["note.txt"]
    shutil.rmtree(note.parent)
    for name in ("results.json", "episodes.parquet"):
        ours, theirs = ((folder / name).read_bytes() for folder in (tmp_path, whole))
        assert ours.replace(b'"threads": 1', b'"threads": 2') == theirs.replace(b'"threads": 1', b'"threads": 2'), name


@pytest.mark.parametrize("content", ["{", "[]", '{"schema": 9}'])
def test_a_manifest_that_is_none_is_refused(tmp_path, content) -> None:
    (tmp_path / "manifest.json").write_text(content, encoding="utf-8")
    for arguments in (("--resume", "--out", tmp_path), ("report", tmp_path)):
        code, error = evaluate(*arguments)
        assert (code, error.count("\n"), "manifest.json" in error) == (2, 1, True)


def test_another_machine_or_version_is_refused_and_another_commit_of_the_same_code_is_not(
    tmp_path, whole, monkeypatch
) -> None:
    folder, versions = unfinished(whole, tmp_path), manifest.versions()
    for what, now, words in (
        ("versions", versions | {"mujoco": "9.9"}, "mujoco was .* and is 9.9"),
        ("code_digest", "f" * 64, "the code of quad_env, policies or evaluate has changed"),
        ("cpu_model", "an abacus", "the processor was .* and is an abacus"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(manifest, what, lambda now=now: now)
            code, error = evaluate("--resume", "--out", folder)
        assert (code, error.count("\n")) == (2, 1)
        assert re.search(words, error)
    monkeypatch.setattr(manifest, "versions", lambda: versions | {"git_revision": "0" * 40})
    assert evaluate("--resume", "--out", folder)[0] == 0
    assert_same(tmp_path, whole)


@pytest.mark.parametrize(("edit", "code"), [("# a comment\n", 0), ('"""A docstring."""\n', 0), ("EXTRA = 1\n", 2)])
def test_an_edit_of_comments_does_not_stop_a_run_from_going_on(repository, tmp_path, monkeypatch, edit, code) -> None:
    """An edit of a statement stops the resumption; an edit of a comment does not."""
    copy, out = tmp_path / "repository", tmp_path / "out"
    for package in provenance.SOURCES:
        shutil.copytree(repository / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(provenance, "REPOSITORY", copy)
    provenance.code_digest.cache_clear()
    assert evaluate(*RUN, "--out", out)[0] == 0
    module = copy / "policies" / "base.py"
    module.write_text(module.read_text(encoding="utf-8") + edit, encoding="utf-8")
    provenance.code_digest.cache_clear()
    found, error = evaluate("--resume", "--out", unfinished(out, tmp_path / "unfinished"))
    provenance.code_digest.cache_clear()
    assert found == code, error


@pytest.mark.parametrize("damage", ["flipped", "changed", "another run's"])
def test_a_damaged_part_is_done_again(tmp_path, whole, damage) -> None:
    path = sorted(unfinished(whole, tmp_path).glob("parts/*.parquet"))[0]
    content = path.read_bytes()
    flipped, chunk = bytearray(content), pq.read_metadata(path).row_group(0).column(0)
    flipped[chunk.data_page_offset + chunk.total_compressed_size // 2] ^= 1
    path.write_bytes({"flipped": bytes(flipped)}.get(damage, content))
    if damage == "another run's":
        write_table(read_table(path), path, "another")
    if damage == "changed":
        rows = pq.read_table(path)
        place = rows.schema.get_field_index("energy")
        pq.write_table(rows.set_column(place, "energy", pa.array(np.zeros(rows.num_rows))), path)
    said = f"1 of 4 parts in {tmp_path / 'parts'} left out, as damaged, changed or of another run"
    assert said in evaluate("report", tmp_path)[1]
    code, error = evaluate("--resume", "--out", tmp_path)
    assert code == 0, error
    assert said in error
    assert_same(tmp_path, whole)


def test_a_finished_run_is_finished_and_its_report_made_again_without_simulating(tmp_path, whole, monkeypatch) -> None:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    replace_simulation(monkeypatch, full)
    code, error = evaluate("--resume", "--out", tmp_path)
    assert (code, "nothing is left" in error) == (0, True)
    assert_same(tmp_path, whole)
    for name in ("results.json", "report.html"):
        (tmp_path / name).unlink()
    assert evaluate("report", tmp_path)[0] == 0
    assert_same(tmp_path, whole)


def test_a_report_of_an_unfinished_run_shows_its_finished_cells(tmp_path, whole) -> None:
    assert evaluate("report", unfinished(whole, tmp_path))[0] == 0
    results = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert results["complete"] is False
    assert {p: list(entry["scenarios"]) for p, entry in results["policies"].items()} == {"stand": ["flat"]}
    assert evaluate("--resume", "--out", tmp_path)[0] == 0
    assert_same(tmp_path, whole)


def test_other_options_are_refused_by_name(tmp_path, whole) -> None:
    folder = unfinished(whole, tmp_path)
    before = sorted(path.name for path in folder.rglob("*"))
    words = ["--episodes", "6", "--seed", "3", "--quick", "--scenarios", "quick"]
    code, error = evaluate(*words, "--resume", "--out", folder)
    assert (code, error.count("\n")) == (2, 1), error
    for word in ("--episodes was 5, not 6", "--seed was 2, not 3", "--quick was False, not True", "--scenarios"):
        assert word in error
    assert sorted(path.name for path in folder.rglob("*")) == before


def full(*_arguments, **_options):
    """Replacement of a function that writes to a disk; it raises the error of a full disk."""
    raise OSError(28, "No space left on device")


def full_disk_for(name: str) -> Callable[[pytest.MonkeyPatch], None]:
    """Return a function that makes writes of the files with a name fail, in tests with its `patch`."""
    return lambda patch: full_disk(patch, name)


@pytest.mark.parametrize(
    ("prepare", "said"),
    [
        (
            partial(replace_simulation, simulate=full),
            "cannot go on (No space left on device); begin again, for nothing",
        ),
        (full_disk_for("*.parquet"), "cannot write to {} (No space left on device); make room, then begin"),
        (full_disk_for("manifest.json"), "make room, then begin again, for nothing was done yet"),
    ],
)
def test_errors_of_the_simulation_and_of_the_results_folder_have_different_remedies(
    tmp_path, monkeypatch, prepare, said
) -> None:
    prepare(monkeypatch)
    code, error = evaluate(*RUN, "--threads", "1", "--out", tmp_path)
    assert code == 2
    assert said.format(tmp_path) in error.splitlines()[-1]


def test_a_disk_that_is_full_later_on_says_how_to_go_on(tmp_path, monkeypatch) -> None:
    write_table_there = store.write_table

    def once(*arguments):
        monkeypatch.setattr(store, "write_table", full)
        write_table_there(*arguments)

    monkeypatch.setattr(store, "write_table", once)
    code, error = evaluate(*RUN, "--threads", "1", "--out", tmp_path)
    assert code == 2
    line = error.splitlines()[-1]
    assert "(No space left on device); make room, then " in line
    assert line.endswith(f"--resume --out {tmp_path}")
    monkeypatch.setattr(store, "write_table", write_table_there)
    assert evaluate("--resume", "--out", tmp_path)[0] == 0
