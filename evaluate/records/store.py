"""A run's folder: its manifest, the episodes that are done, and the whole run read back from there."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from evaluate.records import manifest as manifests
from evaluate.records.episode_table import cell_of, read_table, table, write_table
from evaluate.records.manifest import CHUNKS, FILES, JUNIT, Manifest
from evaluate.rollouts.experiment import Cell, Chunk, evaluation_seeds, join
from evaluate.terminal.command_line import UsageError
from quad_env.scenarios.named import Scenario

EPISODES = "episodes.parquet"
_CHUNK = re.compile(r"\d{5}-\d{7}\.parquet")
_TEMPORARY = re.compile(rf"\.({'|'.join(map(re.escape, (*FILES, JUNIT)))}|{_CHUNK.pattern})\..{{8}}")


@dataclass(frozen=True)
class Run:
    """What a folder holds."""

    manifest: Manifest
    cells: tuple[Cell, ...]
    """The finished ones, in the order of the run."""

    @property
    def complete(self) -> bool:
        """Whether every cell is there."""
        return len(self.cells) == len(self.manifest.cells)


class ChunkStore:
    """Folder of a run under way, into which its chunks go as they come, each whole or not at all."""

    def __init__(self, folder: Path, manifest: Manifest, resumed: bool = False) -> None:
        self.folder, self.manifest = folder, manifest
        self.begun = resumed
        """Whether the folder is this run's; until its first chunk it belongs to whatever was there before."""
        self._seeds = evaluation_seeds(manifest.seed, manifest.episodes)
        self._policies = list(manifest.policies)

    def load(self, policy: str, scenario: Scenario) -> Sequence[Chunk]:
        """Chunks of that cell that are done already; damaged ones, and other runs', are left out."""
        if not self.begun:
            return ()
        found: list[Chunk] = []
        done = np.zeros(len(self._seeds), bool)
        for path in sorted((self.folder / CHUNKS).glob(f"{self._number(policy, scenario):05d}-*.parquet")):
            chunk = self._read(path, scenario)
            if chunk is not None and not done[chunk.numbers].any():
                done[chunk.numbers] = True
                found.append(chunk)
        return found

    def save(self, chunk: Chunk) -> None:
        """Write a chunk; OSError if that fails."""
        if not self.begun:
            self._begin()
        name = f"{self._number(chunk.cell.policy, chunk.cell.scenario):05d}-{chunk.numbers[0]:07d}.parquet"
        write_table(table(chunk.cell, chunk.numbers), self.folder / CHUNKS / name, self.manifest.fingerprint)

    def _begin(self) -> None:
        # In this order: a manifest never stands beside chunks of another run.
        remove_chunks(self.folder)
        self.manifest.write(self.folder)
        (self.folder / CHUNKS).mkdir(exist_ok=True)
        self.begun = True

    def _number(self, policy: str, scenario: Scenario) -> int:
        """Number of the cell, in the order of the run."""
        return self.manifest.scenarios.index(scenario) * len(self._policies) + self._policies.index(policy)

    def _read(self, path: Path, scenario: Scenario) -> Chunk | None:
        try:
            rows = read_table(path, self.manifest.fingerprint)
            chunk = Chunk(rows.column("episode").to_numpy(), cell_of(rows, scenario))
        except (OSError, ValueError):
            return None
        return chunk if np.array_equal(self._seeds[chunk.numbers], chunk.cell.seeds) else None


def read_run(folder: Path) -> Run:
    """The run in a folder, finished or not. Raises UsageError or OSError, one line, if there is none to be read."""
    manifest, rows = read_rows(folder)
    try:
        return Run(manifest, tuple(_cells(manifest, rows)))
    except ValueError as error:
        raise _unreadable(folder, error) from error


def read_rows(folder: Path) -> tuple[Manifest, pa.Table]:
    """The rows of the finished cells, with the columns that they were written with; errors as of `read_run`."""
    manifest = manifests.read(folder)
    if is_unfinished(folder):
        store = ChunkStore(folder, manifest, resumed=True)
        finished = [table(cell) for cell in _from_chunks(store)]
        return manifest, pa.concat_tables(finished) if finished else pa.table({})
    path = folder / EPISODES
    try:
        return manifest, read_table(path, manifest.fingerprint) if path.is_file() else pa.table({})
    except ValueError as error:
        raise _unreadable(folder, error) from error


def rows_of(rows: pa.Table, policy: str, scenario: str) -> pa.Table:
    """The rows of one cell."""
    return rows.filter((pc.field("policy") == policy) & (pc.field("scenario") == scenario))


def is_unfinished(folder: Path) -> bool:
    """Whether the folder holds chunks of a run that has not come to its end."""
    return (folder / manifests.NAME).is_file() and any(_chunks(folder))


def remove_chunks(folder: Path) -> None:
    """Remove the chunks of a run, whose episodes stand elsewhere, and what a killed one left half written."""
    for path in _chunks(folder):
        path.unlink(missing_ok=True)
    for place in (folder / CHUNKS, folder):
        for path in place.glob(".*"):
            if _TEMPORARY.fullmatch(path.name):
                path.unlink(missing_ok=True)
    try:
        (folder / CHUNKS).rmdir()
    except OSError:  # not there, or somebody else keeps something in it
        return


def _chunks(folder: Path) -> Iterator[Path]:
    return (path for path in (folder / CHUNKS).glob("*.parquet") if _CHUNK.fullmatch(path.name))


def _from_chunks(store: ChunkStore) -> Iterator[Cell]:
    for scenario, policy in store.manifest.cells:
        chunks = store.load(policy, scenario)
        if sum(len(chunk.numbers) for chunk in chunks) == store.manifest.episodes:
            yield join(chunks)


def _cells(manifest: Manifest, rows: pa.Table) -> Iterator[Cell]:
    for scenario, policy in manifest.cells if rows.num_rows else ():
        mine = rows_of(rows, policy, scenario.name)
        if mine.num_rows == manifest.episodes:
            yield cell_of(mine, scenario)


def _unreadable(folder: Path, error: ValueError) -> UsageError:
    return UsageError(f"{folder / EPISODES} cannot be read as the run of {manifests.NAME}: {error}")
