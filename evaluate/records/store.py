"""A run's folder: its manifest, the episodes that are done, and the whole run read back from there."""

import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from evaluate.cells import EpisodeChunk, PolicyScenarioResult, evaluation_seeds, join
from evaluate.records import manifest as manifests
from evaluate.records.episode_table import NEEDED, cell_of, read_table, table, write_table
from evaluate.records.manifest import CHUNKS, FILES, Manifest
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import counted
from quad_env.scenarios.named import Scenario

EPISODES = "episodes.parquet"
_CHUNK = re.compile(r"\d{5}-\d{7}(-[0-9a-f]{8})?\.parquet")
"""Numbers of the cell and of the first episode, and the beginning of the run's fingerprint."""
_TEMPORARY = re.compile(rf"\.({'|'.join(map(re.escape, FILES))}|{_CHUNK.pattern})\..{{8}}")


@dataclass(frozen=True)
class Run:
    """What a folder holds."""

    manifest: Manifest
    cells: tuple[PolicyScenarioResult, ...]
    """The finished ones, in the order of the run."""
    stored: bool = False
    """Whether they were read from the folder's episodes.parquet, and from there alone."""

    @property
    def complete(self) -> bool:
        """Whether every cell is there, and no more episodes are to come."""
        return len(self.cells) == len(self.manifest.cells) and not self.manifest.is_unsettled


class ChunkStore:
    """Folder of a run under way, into which its chunks go as they come, each whole or not at all."""

    def __init__(self, folder: Path, manifest: Manifest, resumed: bool = False) -> None:
        self.folder, self.manifest = folder, manifest
        self.begun = resumed
        """Whether the folder is this run's; until its first chunk it belongs to whatever was there before."""
        self._policies = list(manifest.policies)

    def load(self, policy: str, scenario: Scenario) -> Sequence[EpisodeChunk]:
        """Chunks of that cell that are done already; damaged ones, other runs' and later episodes are left out."""
        if not self.begun:
            return ()
        found: list[EpisodeChunk] = []
        done = np.zeros(self.manifest.episodes, bool)
        for path in sorted((self.folder / CHUNKS).glob(f"{self._number(policy, scenario):05d}-*.parquet")):
            chunk = self._read(path, scenario)
            if chunk is not None and not done[chunk.episode_indices].any():
                done[chunk.episode_indices] = True
                found.append(chunk)
        return found

    def save(self, chunk: EpisodeChunk) -> None:
        """Write a chunk; OSError if that fails."""
        number = self._number(chunk.cell.policy, chunk.cell.scenario)
        name = f"{number:05d}-{chunk.episode_indices[0]:07d}-{self.manifest.fingerprint[:8]}.parquet"
        (self.folder / CHUNKS).mkdir(exist_ok=True)
        write_table(table(chunk.cell, chunk.episode_indices), self.folder / CHUNKS / name, self.manifest.fingerprint)
        if not self.begun:
            # Only now, and at once: until here the folder is that of whatever was there before.
            self.manifest.write(self.folder)
            remove_chunks(self.folder, but=name)
            self.begun = True

    def _number(self, policy: str, scenario: Scenario) -> int:
        """Number of the cell, in the order of the run."""
        return self.manifest.scenarios.index(scenario) * len(self._policies) + self._policies.index(policy)

    def _read(self, path: Path, scenario: Scenario) -> EpisodeChunk | None:
        try:
            rows = read_table(path, self.manifest.fingerprint)
            chunk = EpisodeChunk(rows.column("episode").to_numpy(), cell_of(rows, scenario))
            seeds = evaluation_seeds(self.manifest.seed, self.manifest.episodes)
            return chunk if np.array_equal(seeds[chunk.episode_indices], chunk.cell.seeds) else None
        except (LookupError, OSError, ValueError):
            return None


def read_run(folder: Path) -> Run:
    """The run in a folder, finished or not. Raises UsageError or OSError, one line, if there is none to be read."""
    manifest, rows, stored = _read(folder)
    try:
        return Run(manifest, tuple(_cells(manifest, rows)), stored)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _unreadable(folder, error) from error


def read_rows(folder: Path) -> tuple[Manifest, pa.Table]:
    """The rows of the finished cells, with the columns that they were written with; errors as of `read_run`."""
    return _read(folder)[:2]


def _read(folder: Path) -> tuple[Manifest, pa.Table, bool]:
    """Manifest, rows, and whether these are those of episodes.parquet; errors as of `read_run`."""
    manifest, parts = manifests.read(folder), is_unfinished(folder)
    try:
        rows = _stored(folder / EPISODES, manifest)
    except ValueError as error:
        if not parts:
            raise _unreadable(folder, error) from error
        rows = pa.table({})
    if not parts or rows.num_rows == manifest.episodes * len(manifest.cells):
        return manifest, rows, bool(rows.num_rows)
    cells = [table(cell) for cell in _from_chunks(ChunkStore(folder, manifest, True))]
    return manifest, pa.concat_tables(cells) if cells else pa.table({}), False


def _stored(path: Path, manifest: Manifest) -> pa.Table:
    """The rows of episodes.parquet, none if there is no such file; ValueError unless they are whole cells of the run
    in its order, as they were written; an interrupted run has not come to all."""
    if not path.exists():
        return pa.table({})
    rows = read_table(path, manifest.fingerprint)
    if lacking := sorted(NEEDED - set(rows.column_names)):
        raise ValueError(f"it lacks the columns {', '.join(lacking)}")
    found = list(zip(*(rows.column(name).to_pylist() for name in ("scenario", "policy", "episode")), strict=True))
    there = {(scenario, policy) for scenario, policy, _ in found}
    cells = [(scenario.name, policy) for scenario, policy in manifest.cells]
    wanted = [(*cell, number) for cell in cells if cell in there for number in range(manifest.episodes)]
    if found != wanted:
        raise ValueError("episodes are missing, there twice, not of this run or not in their order")
    return rows


def rows_of(rows: pa.Table, policy: str, scenario: str) -> pa.Table:
    """The rows of one cell."""
    return rows.filter((pc.field("policy") == policy) & (pc.field("scenario") == scenario))


def is_unfinished(folder: Path) -> bool:
    """Whether the folder holds chunks of a run that has not come to its end."""
    return (folder / manifests.NAME).is_file() and any(_chunks(folder))


def remove_chunks(folder: Path, but: str = "") -> None:
    """Remove the chunks of a run, whose episodes stand elsewhere, and what a killed one left half written; `but` stays,
    and what else is kept there."""
    for path in _chunks(folder):
        if path.name != but:
            path.unlink(missing_ok=True)
    for place in (folder / CHUNKS, folder):
        for path in place.glob(".*"):
            if _TEMPORARY.fullmatch(path.name):
                path.unlink(missing_ok=True)
    try:
        (folder / CHUNKS).rmdir()
    except OSError:  # not there, or something else is kept in it
        return


def _chunks(folder: Path) -> Iterator[Path]:
    return (path for path in (folder / CHUNKS).glob("*.parquet") if _CHUNK.fullmatch(path.name))


def _from_chunks(store: ChunkStore) -> Iterator[PolicyScenarioResult]:
    """The cells of which every part is there; how many parts cannot be used is reported on stderr."""
    there, used = sum(int(path.name[6:13]) < store.manifest.episodes for path in _chunks(store.folder)), 0
    for scenario, policy in store.manifest.cells:
        chunks = store.load(policy, scenario)
        used += len(chunks)
        if sum(len(chunk.episode_indices) for chunk in chunks) == store.manifest.episodes:
            yield join(chunks)
    if used < there:
        left_out = (
            f"{there - used} of {counted(there, 'part')} in {store.folder / CHUNKS} left out, as damaged, changed"
        )
        print(f"{left_out} or of another run; --resume simulates what is missing", file=sys.stderr)


def _cells(manifest: Manifest, rows: pa.Table) -> Iterator[PolicyScenarioResult]:
    for scenario, policy in manifest.cells if rows.num_rows else ():
        mine = rows_of(rows, policy, scenario.name)
        if mine.num_rows:
            yield cell_of(mine, scenario)


def _unreadable(folder: Path, error: Exception) -> UsageError:
    remedy = "restore it, or run the evaluation again"
    return UsageError(f"{folder / EPISODES} cannot be read as the run of {manifests.NAME}: {error}; {remedy}")
