"""A results folder that is not as it was written is recognised: one line, exit code 2, and nothing in it is changed."""

import contextlib
import copy
import dataclasses
import errno
import io
import json
import resource
import shutil
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from evaluate.__main__ import main
from evaluate.records import manifest as manifests
from evaluate.records.episode_table import RUN, read_table, write_parquet
from evaluate.records.manifest import NAME
from evaluate.records.parquet import SHA256, content_hash
from evaluate.records.store import EPISODES, ChunkStore, read_run
from evaluate.rollouts import rollout
from evaluate.rollouts.experiment import Chunk
from research.__main__ import main as research

OLD = Path(__file__).parents[2] / "data" / "results_of_2c74e47"
"""Written before there were hashes."""
EDITS: tuple[Any, ...] = (None, True, -1, 1.5, 10**12, float("nan"), "text", "", [], {}, [None], {"type": "Flat"})
"""What a value is replaced by."""
NOT_OF_A_TYPE = ("severity",)
"""Numbers of a scenario that no axis has, which only somebody who writes the fingerprint again can put there."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The old results as this version writes them, with their traces."""
    run = read_run(OLD)
    manifest = run.manifest.begun()
    manifest.write(tmp_path)
    write_parquet(run.cells, tmp_path / EPISODES, manifest.fingerprint)
    shutil.copytree(OLD / "traces", tmp_path / "traces")
    return tmp_path


@pytest.fixture(autouse=True)
def no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report of which the page, whose plots take a second, is left out."""
    monkeypatch.setattr("evaluate.commands.outputs.write_report", lambda *_, **__: None)


def command(*arguments: object) -> tuple[int, str]:
    """Exit code and stderr."""
    error = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(error):
        words = [str(argument) for argument in arguments]
        code = (research if words[0] == "rescore" else main)(words)
    return code, error.getvalue()


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def commands_on(folder: Path) -> Iterator[tuple[object, ...]]:
    """Every command that reads a run's folder."""
    yield "report", folder, "--no-film"
    yield "compare", folder, OLD
    yield "compare", OLD, folder
    yield "replay", folder, 0
    yield "rescore", folder


def assert_refused(folder: Path, words: str) -> None:
    before = contents(folder)
    for arguments in commands_on(folder):
        code, said = command(*arguments)
        lines = [line for line in said.splitlines() if str(OLD) not in line]
        assert (code, len(lines)) == (2, 1), (arguments, said)
        assert words in lines[0], arguments
    assert contents(folder) == before


def rewritten(folder: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """Rows changed by somebody who knows nothing of the hash, and keeps it."""
    path = folder / EPISODES
    rows = pq.read_table(path)
    pq.write_table(change(rows).replace_schema_metadata(rows.schema.metadata), path)


def column(rows: pa.Table, name: str, values: pa.Array) -> pa.Table:
    place = rows.schema.get_field_index(name)
    return rows.set_column(place, pa.field(name, values.type, metadata=rows.schema.field(name).metadata), values)


def with_value(name: str, row: int, value: object) -> Callable[[pa.Table], pa.Table]:
    def change(rows: pa.Table) -> pa.Table:
        values = rows.column(name).to_pylist()
        values[row] = value
        return column(rows, name, pa.array(values, rows.schema.field(name).type))

    return change


def test_a_folder_as_it_was_written_is_read_by_every_command(folder) -> None:
    for arguments in commands_on(folder):
        if arguments[0] == "replay":  # whose episode is another processor's
            continue
        code, said = command(*arguments)
        assert code == 0, said
        assert str(folder / EPISODES) not in said


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: rows.slice(1), "1 episode is missing: 0 of trot on flat"),
        (lambda rows: pa.concat_tables([rows.slice(0, 4), rows.slice(6)]), "2 episodes are missing: 1 of document_rep"),
        (lambda rows: pa.concat_tables([rows, rows.slice(2, 1)]), "1 episode is there twice: 2 of trot on flat"),
        (lambda rows: pa.concat_tables([rows.slice(3, 3), rows.slice(0, 3), rows.slice(6)]), "not in the order"),
        (lambda rows: rows.take([1, 0, *range(2, rows.num_rows)]), "not in the order"),
        (lambda rows: pa.concat_tables([rows.slice(6), rows.slice(6)]), "12 episodes are there twice"),
        (with_value("policy", 0, "walk"), "1 episode is not of this run: 0 of walk on flat"),
        (with_value("outcome", 0, "fell"), "has been changed since it was written"),
        (with_value("velocity_error", 7, 0.0), "has been changed since it was written"),
        (with_value("seed", 3, 5), "has been changed since it was written"),
        (lambda rows: column(rows, "seed", rows.column("seed").cast(pa.string())), "its column seed holds string"),
        (with_value("seed", 3, None), "its column seed holds"),
        (lambda rows: rows.drop_columns(["policy"]), "it lacks the columns policy"),
        (lambda rows: rows.replace_schema_metadata(None).append_column("seed", rows.column("seed")), "have one name"),
    ],
)
def test_rows_that_were_changed_are_named(folder, change, words) -> None:
    rewritten(folder, change)
    assert_refused(folder, words)


def test_rows_of_a_version_without_hashes_are_checked_as_far_as_they_can_be(tmp_path) -> None:
    shutil.copytree(OLD, tmp_path, dirs_exist_ok=True)
    code, said = command("report", tmp_path, "--no-film")
    assert (code, said.count("\n")) == (0, 1)
    assert "whether its rows have been changed is not known" in said
    assert (tmp_path / EPISODES).read_bytes() == (OLD / EPISODES).read_bytes()
    rewritten(tmp_path, lambda rows: rows.slice(1))
    before = contents(tmp_path)
    code, said = command("report", tmp_path, "--no-film")
    assert (code, said.count("\n"), "1 episode is missing: 0 of trot on flat" in said) == (2, 1, True)
    assert contents(tmp_path) == before


def places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where something stands in a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in items:
        yield (*place, key)
        yield from places(entry, (*place, key))


def edited(contents: Any, place: tuple[Any, ...], value: Any) -> Any:
    found = copy.deepcopy(contents)
    at = found
    for key in place[:-1]:
        at = at[key]
    at[place[-1]] = value
    return found


def forged(contents: dict[str, Any]) -> dict[str, Any]:
    """With the fingerprint of what it now says, as no hash is known to an older version."""
    found = {name: value for name, value in contents.items() if name != "sha256"}
    of_figures = {k: v for k, v in found.items() if k not in ("schema", "options", "date", "fingerprint")}
    with contextlib.suppress(AttributeError, KeyError, TypeError):
        found["fingerprint"] = manifests._fingerprint(of_figures)
    return found


def test_every_edit_of_a_manifest_is_recognised(folder) -> None:
    """Any field, at any depth, replaced by any value, or left out."""
    good = json.loads((folder / NAME).read_text())
    for number, place in enumerate(places(good)):
        value = EDITS[number % len(EDITS)]
        if (bad := edited(good, place, value)) == good:
            continue
        (folder / NAME).write_text(json.dumps(bad))
        before = contents(folder)
        code, said = command("compare", folder, folder)
        assert (code, said.count("\n")) == (2, 1), (place, value)
        assert NAME in said
        assert contents(folder) == before
    for name in good.keys() - {"sha256"}:
        (folder / NAME).write_text(json.dumps({key: value for key, value in good.items() if key != name}))
        assert command("compare", folder, folder)[0] == 2


def test_no_command_takes_an_edited_manifest(folder) -> None:
    path = folder / NAME
    good = json.loads(path.read_text())
    for place, value in ((("seed",), 7), (("options", "seed"), 7), (("date",), "2020-01-01"), (("episodes",), 10**12)):
        path.write_text(json.dumps(edited(good, place, value)))
        assert_refused(folder, f"{NAME} has been changed since it was written")
        code, said = command("--resume", "--out", folder)
        assert (code, said.count("\n"), "has been changed" in said) == (2, 1, True)
    path.write_text(path.read_text().replace('"schema": 1,', '"schema": 1, "schema": 1,'))
    assert_refused(folder, "'schema' is given twice")


def test_whatever_type_a_manifest_holds_there_is_no_traceback(folder) -> None:
    """Even with a fingerprint that fits: exit code 0 or 2, one line at most beside what is always said."""
    good, rows = json.loads((folder / NAME).read_text()), pq.read_table(folder / EPISODES)
    codes = set()
    for number, place in enumerate(place for place in places(good) if place[-1] not in NOT_OF_A_TYPE):
        for value in (EDITS[number % len(EDITS)], EDITS[(5 * number + 3) % len(EDITS)]):
            bad = forged(edited(good, place, value))
            (folder / NAME).write_text(json.dumps(bad))
            pq.write_table(rows.replace_schema_metadata({RUN: str(bad.get("fingerprint")).encode()}), folder / EPISODES)
            before = contents(folder)
            code, said = command("report", folder, "--no-film")
            codes.add(code)
            assert (code, said.count("\n")) in ((0, 1), (2, 1), (2, 2)), (place, value, said)
            after = contents(folder)
            assert {name: after[name] for name in before if code == 2 or name in (NAME, EPISODES)} == (
                before if code == 2 else {name: before[name] for name in (NAME, EPISODES)}
            )
            for name in after.keys() - before.keys():
                (folder / name).unlink()
    assert codes == {0, 2}


def other_types(values: pa.ChunkedArray) -> Iterator[pa.Array]:
    """A column's values as others, or none."""
    count = len(values)
    yield pa.nulls(count, values.type)
    yield pa.array(["text"] * count)
    yield pa.array([7] * count, pa.int64())
    yield pa.array([True] * count)
    yield pa.array([[1.0]] * count, pa.list_(pa.float64()))
    yield pa.array([[[1.0], None]] * count, pa.list_(pa.list_(pa.float64())))
    yield pa.array([[[1.0], [2.0, 3.0]], []] * (count // 2), pa.list_(pa.list_(pa.float64())))
    yield pa.array([{"a": 1}] * count)


def test_whatever_type_a_column_holds_there_is_no_traceback(tmp_path) -> None:
    """Without a hash, as an older version writes it."""
    shutil.copytree(OLD, tmp_path, dirs_exist_ok=True)
    rows = pq.read_table(tmp_path / EPISODES)
    codes = set()
    for name in rows.column_names:
        for values in other_types(rows.column(name)):
            pq.write_table(column(rows, name, values), tmp_path / EPISODES)
            before = contents(tmp_path)
            code, said = command("report", tmp_path, "--no-film")
            codes.add(code)
            assert (code, said.count("\n")) in ((0, 1), (2, 1), (2, 2)), (name, values.type, said)
            after = contents(tmp_path)
            assert after[EPISODES] == before[EPISODES]
            assert code == 0 or after == before
    assert codes == {0, 2}


def test_a_fall_without_a_time_is_refused(tmp_path) -> None:
    shutil.copytree(OLD, tmp_path, dirs_exist_ok=True)
    fallen = pq.read_table(tmp_path / EPISODES).column("fell").to_pylist().index(True)
    rewritten(tmp_path, with_value("fall_time", fallen, None))
    code, said = command("report", tmp_path, "--no-film")
    assert (code, "fell at no time" in said) == (2, True)


def test_a_flipped_bit_of_the_footer_is_refused(folder) -> None:
    """One bit in 83 of them; the column's pages have checksums of their own."""
    path = folder / EPISODES
    good, run = path.read_bytes(), read_run(folder).manifest.fingerprint
    footer = struct.unpack("<I", good[-8:-4])[0] + 8
    harmless = 0
    for bit in range(0, 8 * footer, 83):
        bad = bytearray(good)
        bad[len(good) - footer + bit // 8] ^= 1 << bit % 8
        path.write_bytes(bad)
        try:
            rows = read_table(path, run)
        except ValueError:
            continue
        harmless += 1  # statistics, say: what is read is what was written
        path.write_bytes(good)
        assert rows.equals(read_table(path, run))
    assert harmless < footer * 8 // 83


def test_the_hash_is_of_values_and_types_and_names_and_of_nothing_else(folder) -> None:
    rows = read_table(folder / EPISODES)
    stored = rows.schema.metadata[SHA256].decode()
    assert content_hash(rows) == stored
    assert content_hash(pa.concat_tables([rows.slice(0, 5), rows.slice(5)])) == stored
    pq.write_table(rows, folder / EPISODES, compression="zstd", row_group_size=4)
    assert content_hash(read_table(folder / EPISODES)) == stored
    first = rows.column("velocity_error")[0].as_py()
    for other in (
        with_value("velocity_error", 0, np.nextafter(first, 1.0))(rows),
        with_value("energy", 0, -0.0)(with_value("energy", 0, 0.0)(rows)),
        rows.rename_columns({"energy": "effort"}),
        column(rows, "episode", rows.column("episode").cast(pa.int32())),
        with_value("commands", 0, [[0.0, 0.0, None]])(rows),
        rows.replace_schema_metadata({RUN: b"another"}),
    ):
        assert content_hash(other) != stored
    a, b = (with_value("energy", 0, value)(rows) for value in (0.0, -0.0))
    assert content_hash(a) != content_hash(b)


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="the system limits no file's size")
def test_a_disk_that_is_full_before_the_first_part_leaves_the_earlier_result(folder, monkeypatch) -> None:
    """A limit of a file's size stands for the full disk: the manifest would fit, the first part does not."""
    monkeypatch.setattr(rollout, "STEPS", 110)
    before = contents(folder)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, hard))
    try:
        code, said = command("stand", "--scenarios", "flat", "--episodes", "2", "--no-film", "--out", folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (code, "begin again, for nothing was done yet" in said) == (2, True)
    assert contents(folder) == before
    assert command("compare", folder, folder)[0] == 0


def test_a_process_that_dies_between_the_first_part_and_the_manifest_leaves_the_earlier_result(
    folder, monkeypatch
) -> None:
    monkeypatch.setattr(rollout, "STEPS", 110)
    with monkeypatch.context() as patch:
        patch.setattr(manifests.Manifest, "write", fails)
        code, _ = command("stand", "--scenarios", "flat", "--episodes", "2", "--no-film", "--out", folder)
    assert (code, len(list(folder.glob("parts/*.parquet")))) == (2, 1)
    assert read_run(folder).complete
    assert command("report", folder, "--no-film")[0] == 0
    assert not (folder / "parts").exists()


def fails(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_lost_part_does_not_cost_the_rows_that_the_table_has(folder) -> None:
    """As after a kill while the parts of a finished run were being removed."""
    run = read_run(folder)
    store = ChunkStore(folder, run.manifest, resumed=True)
    for cell in run.cells[:2]:
        store.save(Chunk(np.arange(cell.episodes), cell))
    rows = (folder / EPISODES).read_bytes()
    assert command("report", folder, "--no-film")[0] == 0
    assert (folder / EPISODES).read_bytes() == rows
    # Of an interrupted run, whose table has one cell and whose parts have another.
    write_parquet(run.cells[:1], folder / EPISODES, run.manifest.fingerprint)
    store.save(Chunk(np.arange(run.cells[2].episodes), run.cells[2]))
    assert command("report", folder, "--no-film")[0] == 0
    found = read_run(folder).cells
    assert [(cell.policy, cell.scenario.name) for cell in found] == [("trot", "flat"), ("trot", "push")]
    assert dataclasses.asdict(found[0].measures).keys() == dataclasses.asdict(run.cells[0].measures).keys()
