"""A results folder: saves the chunks of a run that is not finished, and reads a run back."""

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
from evaluate.records.episode_table import (
    add_missing_measures,
    cell_of,
    concatenate,
    missing_measures,
    read_table,
    table,
    write_table,
)
from evaluate.records.manifest import CHUNKS, FILES, Manifest
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import with_count
from quad_env.scenarios.registry import Scenario

EPISODES = "episodes.parquet"
_CHUNK = re.compile(r"\d{5}-\d{7}(-[0-9a-f]{8})?\.parquet")
"""Name of a chunk's file: cell index, index of the first episode, and first digits of the run's fingerprint."""
_FIRST_EPISODE = slice(6, 13)
"""Part of a chunk's file name that is the index of its first episode."""
_TEMPORARY = re.compile(rf"\.({'|'.join(map(re.escape, FILES))}|{_CHUNK.pattern})\..{{8}}")
"""Name of a file that a killed run left half written."""


@dataclass(frozen=True)
class Run:
    """A run read from a folder, finished or not."""

    manifest: Manifest
    cells: tuple[PolicyScenarioResult, ...]
    """Finished cells, in the order of the run."""
    stored: bool = False
    """True if all cells come from the folder's episodes.parquet."""
    missing_measures: tuple[str, ...] = ()
    """Measures that the folder's episodes.parquet lacks; they are NaN or None in the cells."""

    @property
    def complete(self) -> bool:
        """True if every cell is finished and no episodes will be added."""
        return len(self.cells) == len(self.manifest.cells) and not self.manifest.is_unsettled


class ChunkStore:
    """Chunks of a run that is not finished, in files that are written completely or not at all."""

    def __init__(self, folder: Path, manifest: Manifest, resumed: bool = False) -> None:
        self.folder = folder
        self.manifest = manifest
        self.begun = resumed
        """True if the folder belongs to this run. Before the first chunk it belongs to an earlier run."""
        self._policies = list(manifest.policies)

    def load(self, policy: str, scenario: Scenario) -> Sequence[EpisodeChunk]:
        """Return the finished chunks of a cell, without damaged files and files of other runs or seeds.

        Args:
            policy: Label of the policy.
            scenario: Scenario of the cell.

        Returns:
            Chunks without a common episode.
        """
        if not self.begun:
            return ()
        chunks: list[EpisodeChunk] = []
        is_loaded = np.zeros(self.manifest.episodes, bool)
        for path in sorted((self.folder / CHUNKS).glob(f"{self._cell_index(policy, scenario):05d}-*.parquet")):
            chunk = self._read(path, scenario)
            if chunk is not None and not is_loaded[chunk.episode_indices].any():
                is_loaded[chunk.episode_indices] = True
                chunks.append(chunk)
        return chunks

    def save(self, chunk: EpisodeChunk) -> None:
        """Write a chunk, and before the first one of a run replace the earlier run; OSError if that fails."""
        cell_index = self._cell_index(chunk.cell.policy, chunk.cell.scenario)
        name = f"{cell_index:05d}-{chunk.episode_indices[0]:07d}-{self.manifest.fingerprint[:8]}.parquet"
        (self.folder / CHUNKS).mkdir(exist_ok=True)
        write_table(table(chunk.cell, chunk.episode_indices), self.folder / CHUNKS / name, self.manifest.fingerprint)
        if not self.begun:
            self.manifest.write(self.folder)
            remove_chunks(self.folder, but=name)
            self.begun = True

    def _cell_index(self, policy: str, scenario: Scenario) -> int:
        """Return the index of a cell in the order of the run."""
        return self.manifest.scenarios.index(scenario) * len(self._policies) + self._policies.index(policy)

    def _read(self, path: Path, scenario: Scenario) -> EpisodeChunk | None:
        """Read a chunk; None if it is damaged or of another run or another seed."""
        try:
            rows = read_table(path, self.manifest.fingerprint)
            chunk = EpisodeChunk(rows.column("episode").to_numpy(), cell_of(rows, scenario))
            seeds = evaluation_seeds(self.manifest.seed, self.manifest.episodes)
            return chunk if np.array_equal(seeds[chunk.episode_indices], chunk.cell.seeds) else None
        except (LookupError, OSError, ValueError):
            return None


def read_run(folder: Path) -> Run:
    """Read the run in a folder, finished or not; UsageError, one line, or OSError if it cannot be read."""
    manifest, rows, stored = _read(folder)
    try:
        return Run(manifest, tuple(_cells(manifest, rows)), stored, tuple(missing_measures(rows)))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _unreadable(folder, error) from error


def read_rows(folder: Path) -> tuple[Manifest, pa.Table]:
    """Read the manifest and the rows of the finished cells in a folder; errors as for `read_run`."""
    manifest, rows, _ = _read(folder)
    return manifest, rows


def _read(folder: Path) -> tuple[Manifest, pa.Table, bool]:
    """Read the manifest, the rows, and whether they come from episodes.parquet; errors as for `read_run`."""
    manifest = manifests.read(folder)
    has_chunks = is_unfinished(folder)
    try:
        rows = _stored_rows(folder / EPISODES, manifest)
    except ValueError as error:
        if not has_chunks:
            raise _unreadable(folder, error) from error
        rows = pa.table({})
    if not has_chunks or rows.num_rows == manifest.episodes * len(manifest.cells):
        return manifest, rows, bool(rows.num_rows)
    cells = [table(cell) for cell in _from_chunks(ChunkStore(folder, manifest, True))]
    return manifest, concatenate(cells) if cells else pa.table({}), False


def _stored_rows(path: Path, manifest: Manifest) -> pa.Table:
    """Read episodes.parquet; empty if there is no file.

    A measure that the file lacks is added as missing values and named on stderr.

    Args:
        path: The file.
        manifest: Manifest of its run.

    Returns:
        Rows of complete cells in the order of the run; an interrupted run may lack cells.

    Raises:
        ValueError: The rows are not as the run wrote them, or a required column is missing.
    """
    if not path.exists():
        return pa.table({})
    rows = add_missing_measures(read_table(path, manifest.fingerprint))
    found = list(zip(*(rows.column(name).to_pylist() for name in ("scenario", "policy", "episode")), strict=True))
    stored_cells = {(scenario, policy) for scenario, policy, _ in found}
    cells = [(scenario.name, policy) for scenario, policy in manifest.cells]
    expected = [(*cell, number) for cell in cells if cell in stored_cells for number in range(manifest.episodes)]
    if found != expected:
        raise ValueError("episodes are missing, there twice, not of this run or not in their order")
    if missing := missing_measures(rows):
        print(f"{path} has no column {', '.join(missing)}: read as missing values", file=sys.stderr)
    return rows


def rows_of(rows: pa.Table, policy: str, scenario: str) -> pa.Table:
    """Return the rows of one cell, by policy and scenario."""
    return rows.filter((pc.field("policy") == policy) & (pc.field("scenario") == scenario))


def is_unfinished(folder: Path) -> bool:
    """Return True if the folder holds a manifest and chunks, as an unfinished run does."""
    return (folder / manifests.NAME).is_file() and any(_chunk_files(folder))


def remove_chunks(folder: Path, but: str = "") -> None:
    """Remove a run's chunks and the files that a killed run left half written.

    Args:
        folder: Results folder; other files stay.
        but: File name of a chunk that stays.
    """
    for path in _chunk_files(folder):
        if path.name != but:
            path.unlink(missing_ok=True)
    for parent in (folder / CHUNKS, folder):
        for path in parent.glob(".*"):
            if _TEMPORARY.fullmatch(path.name):
                path.unlink(missing_ok=True)
    try:
        (folder / CHUNKS).rmdir()
    except OSError:  # there is no such folder, or it has other files
        return


def _chunk_files(folder: Path) -> Iterator[Path]:
    """Yield the files of chunks, of any run."""
    return (path for path in (folder / CHUNKS).glob("*.parquet") if _CHUNK.fullmatch(path.name))


def _from_chunks(store: ChunkStore) -> Iterator[PolicyScenarioResult]:
    """Yield the cells with all their chunks, and report unusable files on stderr."""
    files = [path for path in _chunk_files(store.folder) if int(path.name[_FIRST_EPISODE]) < store.manifest.episodes]
    file_count = len(files)
    used = 0
    for scenario, policy in store.manifest.cells:
        chunks = store.load(policy, scenario)
        used += len(chunks)
        if sum(len(chunk.episode_indices) for chunk in chunks) == store.manifest.episodes:
            yield join(chunks)
    if used < file_count:
        unused = f"{file_count - used} of {with_count(file_count, 'part')} in {store.folder / CHUNKS} left out"
        print(
            f"{unused}, as damaged, changed or of another run; --resume simulates what is missing",
            file=sys.stderr,
        )


def _cells(manifest: Manifest, rows: pa.Table) -> Iterator[PolicyScenarioResult]:
    """Yield the cells of a run's rows, in the order of the run."""
    if not rows.num_rows:
        return
    for scenario, policy in manifest.cells:
        cell_rows = rows_of(rows, policy, scenario.name)
        if cell_rows.num_rows:
            yield cell_of(cell_rows, scenario)


def _unreadable(folder: Path, error: Exception) -> UsageError:
    """Return the error for an episodes.parquet that does not match the manifest."""
    remedy = "restore it, or run the evaluation again"
    return UsageError(f"{folder / EPISODES} cannot be read as the run of {manifests.NAME}: {error}; {remedy}")
