"""An altered results folder is detected: one line, exit code 2, and the folder is left unchanged."""

import contextlib
import errno
import io
import json
import re
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
from evaluate.cells import EpisodeChunk
from evaluate.records import manifest as manifests
from evaluate.records.episode_table import RUN, read_table
from evaluate.records.manifest import NAME
from evaluate.records.parquet import SHA256, content_hash
from evaluate.records.store import EPISODES, ChunkStore, read_run
from evaluate.rollouts import rollout
from quad_env.cli.command_line import UsageError
from tests.evaluate.altered import column, with_value

pytestmark = pytest.mark.usefixtures("no_page")


@pytest.fixture
def folder(run: Any, tmp_path: Path) -> Path:
    """Return a writable copy of the results; a second copy, `intact`, is in the same folder."""
    shutil.copytree(run.folder, tmp_path / "intact")
    return Path(shutil.copytree(run.folder, tmp_path / "folder"))


def command(*arguments: object) -> tuple[int, str]:
    """Return exit code and stderr."""
    error = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(error):
        code = main([str(argument) for argument in arguments])
    return code, error.getvalue()


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def commands_on(folder: Path) -> Iterator[tuple[object, ...]]:
    """Yield every command that reads the folder of a run."""
    yield "report", folder
    yield "compare", folder, folder.with_name("intact")
    yield "compare", folder.with_name("intact"), folder
    yield "replay", folder, 0


def assert_refused(folder: Path, words: str) -> None:
    before = contents(folder)
    for arguments in commands_on(folder):
        code, said = command(*arguments)
        assert (code, said.count("\n")) == (2, 1), (arguments, said)
        assert words in said, arguments
    assert contents(folder) == before


def rewritten(folder: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """Change the rows of a run, and keep the old hash."""
    path = folder / EPISODES
    rows = pq.read_table(path)
    pq.write_table(change(rows).replace_schema_metadata(rows.schema.metadata), path)


@pytest.mark.parametrize(
    "change",
    [
        lambda rows: rows.take([1, 0, *range(2, rows.num_rows)]),
        with_value("velocity_error", 7, 0.0),
        lambda rows: column(rows, "seed", list(map(str, rows.column("seed").to_pylist())), pa.string()),
        lambda rows: rows.drop_columns(["policy"]),
    ],
    ids=["order", "value", "type", "column"],
)
def test_changed_rows_are_refused(folder, change) -> None:
    rewritten(folder, change)
    assert_refused(folder, "has been changed since it was written")


def test_rows_without_their_hash_are_refused(folder) -> None:
    path = folder / EPISODES
    rows = pq.read_table(path)
    pq.write_table(rows.replace_schema_metadata({RUN: rows.schema.metadata[RUN]}), path)
    assert_refused(folder, "has been changed since it was written")


def edits(value: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield copies with one entry changed or removed, for each entry."""
    for key in value:
        yield {**value, key: "another"}
        if key != "sha256":
            yield {name: each for name, each in value.items() if name != key}


def test_every_edit_of_a_manifest_is_recognised(folder) -> None:
    good = json.loads((folder / NAME).read_text())
    for bad in ({**good, "policies": {**good["policies"], "trot": "another"}}, *edits(good)):
        (folder / NAME).write_text(json.dumps(bad))
        with pytest.raises(UsageError, match=re.escape(NAME)):
            manifests.read(folder)


def test_no_command_takes_an_edited_manifest(folder) -> None:
    path = folder / NAME
    good = json.loads(path.read_text())
    path.write_text(json.dumps({**good, "seed": 7}))
    assert_refused(folder, f"{NAME} has been changed since it was written")
    code, said = command("--resume", "--out", folder)
    assert (code, said.count("\n"), "has been changed" in said) == (2, 1, True)


def test_a_flipped_bit_of_the_footer_is_refused(folder) -> None:
    """Every 997th bit is flipped; the data pages of the columns have their own checksums."""
    path = folder / EPISODES
    good, run = path.read_bytes(), read_run(folder).manifest.fingerprint
    footer = struct.unpack("<I", good[-8:-4])[0] + 8
    harmless = 0
    for bit in range(0, 8 * footer, 997):
        bad = bytearray(good)
        bad[len(good) - footer + bit // 8] ^= 1 << bit % 8
        path.write_bytes(bad)
        try:
            rows = read_table(path, run)
        except ValueError:
            continue
        harmless += 1  # for example in statistics: the rows that are read equal the written rows
        path.write_bytes(good)
        assert rows.equals(read_table(path, run))
    assert harmless < footer * 8 // 997


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
        column(rows, "episode", rows.column("episode").to_pylist(), pa.int32()),
        with_value("commands", 0, [[0.0, 0.0, None]])(rows),
        rows.replace_schema_metadata({RUN: b"another"}),
    ):
        assert content_hash(other) != stored
    a, b = (with_value("energy", 0, value)(rows) for value in (0.0, -0.0))
    assert content_hash(a) != content_hash(b)


def test_a_process_that_dies_between_the_first_part_and_the_manifest_leaves_the_earlier_result(
    folder, monkeypatch
) -> None:
    monkeypatch.setattr(rollout, "STEPS", 110)
    with monkeypatch.context() as patch:
        patch.setattr(manifests.Manifest, "write", fails)
        code, _ = command("stand", "--scenarios", "flat", "--episodes", "2", "--out", folder)
    assert (code, len(list(folder.glob("parts/*.parquet")))) == (2, 1)
    assert read_run(folder).complete
    assert command("report", folder)[0] == 0
    assert not (folder / "parts").exists()


def fails(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_lost_part_does_not_cost_the_rows_that_the_table_has(folder) -> None:
    """A run that is killed while the parts are removed keeps all rows in its table."""
    run = read_run(folder)
    store = ChunkStore(folder, run.manifest, resumed=True)
    for cell in run.cells[:2]:
        store.save(EpisodeChunk(np.arange(cell.episodes), cell))
    rows = (folder / EPISODES).read_bytes()
    assert command("report", folder)[0] == 0
    assert (folder / EPISODES).read_bytes() == rows
