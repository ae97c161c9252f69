"""Results folder: saves the episodes of a running evaluation, and reads runs back.

A cell is the result of one policy on one scenario. A chunk is a subset of its episodes that are simulated together and
stored in one file.
"""

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
"""Pattern of the file name of a chunk (subset of episodes that are simulated together).

The name contains the index of the policy-scenario pair, the index of the first episode, and the first characters of the
run's fingerprint.
"""
_FIRST_EPISODE = slice(6, 13)
"""Characters of a chunk's file name that are the index of the chunk's first episode."""
_TEMPORARY = re.compile(rf"\.({'|'.join(map(re.escape, FILES))}|{_CHUNK.pattern})\..{{8}}")
"""Pattern of the name of a temporary file that remains if a run is killed while it writes."""


@dataclass(frozen=True)
class Run:
    """A finished or unfinished run, as read from its results folder."""

    manifest: Manifest
    cells: tuple[PolicyScenarioResult, ...]
    """Finished results, one for each pair of policy and scenario, in the order of the run."""
    stored: bool = False
    """True if all results were read from episodes.parquet, and none from the files of an unfinished run."""
    missing_measures: tuple[str, ...] = ()
    """Names of the measures that episodes.parquet lacks; they are NaN or None in the results."""

    @property
    def complete(self) -> bool:
        """True if every pair of policy and scenario is finished and the run will add no episodes."""
        return len(self.cells) == len(self.manifest.cells) and not self.manifest.is_unsettled


class ChunkStore:
    """Store of the finished episodes of an unfinished run, as chunks in a results folder.

    A chunk is a subset of the episodes of one policy on one scenario. Each chunk is one file, which is written
    atomically.
    """

    def __init__(self, folder: Path, manifest: Manifest, resumed: bool = False) -> None:
        self.folder = folder
        self.manifest = manifest
        self.begun = resumed
        """True if the contents of the folder belong to this run.

        It is False until the first chunk of a new run is saved; the folder can still hold an earlier run until then.
        """
        self._policies = list(manifest.policies)

    def load(self, policy: str, scenario: Scenario) -> Sequence[EpisodeChunk]:
        """Return the stored chunks (subsets of episodes) of one policy on one scenario.

        Damaged files and files of other runs or seeds are skipped.

        Args:
            policy: Label of the policy.
            scenario: Scenario.

        Returns:
            Chunks; no two chunks have an episode in common.
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
        """Write the `chunk`, a subset of the episodes of one policy on one scenario, into a file.

        The first chunk of a run replaces the earlier run in the folder. OSError is raised if the file cannot be
        written.
        """
        cell_index = self._cell_index(chunk.cell.policy, chunk.cell.scenario)
        name = f"{cell_index:05d}-{chunk.episode_indices[0]:07d}-{self.manifest.fingerprint[:8]}.parquet"
        (self.folder / CHUNKS).mkdir(exist_ok=True)
        write_table(table(chunk.cell, chunk.episode_indices), self.folder / CHUNKS / name, self.manifest.fingerprint)
        if not self.begun:
            self.manifest.write(self.folder)
            remove_chunks(self.folder, but=name)
            self.begun = True

    def _cell_index(self, policy: str, scenario: Scenario) -> int:
        """Return the index of the pair of `policy` and `scenario` in the order of the run."""
        return self.manifest.scenarios.index(scenario) * len(self._policies) + self._policies.index(policy)

    def _read(self, path: Path, scenario: Scenario) -> EpisodeChunk | None:
        """Read a stored chunk (subset of episodes).

        Args:
            path: File of the chunk.
            scenario: Scenario of the chunk.

        Returns:
            The chunk; None if the file is damaged, or belongs to another run or to other seeds.
        """
        try:
            rows = read_table(path, self.manifest.fingerprint)
            chunk = EpisodeChunk(rows.column("episode").to_numpy(), cell_of(rows, scenario))
            seeds = evaluation_seeds(self.manifest.seed, self.manifest.episodes)
            return chunk if np.array_equal(seeds[chunk.episode_indices], chunk.cell.seeds) else None
        except (LookupError, OSError, ValueError):
            return None


def read_run(folder: Path) -> Run:
    """Read the finished or unfinished run in a results `folder`.

    UsageError or OSError is raised if the run cannot be read.
    """
    manifest, rows, stored = _read(folder)
    try:
        return Run(manifest, tuple(_cells(manifest, rows)), stored, tuple(missing_measures(rows)))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _unreadable(folder, error) from error


def read_rows(folder: Path) -> tuple[Manifest, pa.Table]:
    """Read the manifest and the table of the finished episodes in a results `folder`.

    Only the episodes of finished pairs of policy and scenario are included. Errors are raised as by `read_run`.
    """
    manifest, rows, _ = _read(folder)
    return manifest, rows


def _read(folder: Path) -> tuple[Manifest, pa.Table, bool]:
    """Read the manifest and the table of the finished episodes in a results `folder`.

    The third value is True if the rows are from episodes.parquet. Errors are raised as by `read_run`.
    """
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
    """Read the table episodes.parquet, and check that it contains the episodes of its run.

    Measures that the file lacks are added as missing values, and their names are printed on stderr.

    Args:
        path: Path of episodes.parquet.
        manifest: Manifest of the run.

    Returns:
        One row for each episode, in the order of the run. The table is empty if the file does not exist, and an
        interrupted run may lack some pairs of policy and scenario.

    Raises:
        ValueError: The rows differ from the rows that the run wrote, or a required column is missing.
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
    """Return the `rows` of an episode table that belong to one `policy` on one `scenario`."""
    return rows.filter((pc.field("policy") == policy) & (pc.field("scenario") == scenario))


def is_unfinished(folder: Path) -> bool:
    """Return True if the results `folder` holds an unfinished run: a manifest and files of chunks."""
    return (folder / manifests.NAME).is_file() and any(_chunk_files(folder))


def remove_chunks(folder: Path, but: str = "") -> None:
    """Remove the stored chunks (subsets of episodes) of all runs in a results folder.

    Temporary files that a killed run left behind are removed as well.

    Args:
        folder: Results folder; all other files in it are kept.
        but: File name of one chunk to keep; empty to remove all chunks.
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
    except OSError:  # raised if the folder does not exist or contains other files
        return


def _chunk_files(folder: Path) -> Iterator[Path]:
    """Yield the paths of all stored chunks (subsets of episodes) in a results `folder`, of any run."""
    return (path for path in (folder / CHUNKS).glob("*.parquet") if _CHUNK.fullmatch(path.name))


def _from_chunks(store: ChunkStore) -> Iterator[PolicyScenarioResult]:
    """Yield the result of each pair of policy and scenario for which all episodes are stored.

    Files that are damaged or belong to another run are counted on stderr.
    """
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
    """Convert the episode table of a run to one result for each pair of policy and scenario.

    Args:
        manifest: Manifest of the run.
        rows: Rows of the episodes.

    Yields:
        Results in the order of the run.
    """
    if not rows.num_rows:
        return
    for scenario, policy in manifest.cells:
        cell_rows = rows_of(rows, policy, scenario.name)
        if cell_rows.num_rows:
            yield cell_of(cell_rows, scenario)


def _unreadable(folder: Path, error: Exception) -> UsageError:
    """Return the error for an episodes.parquet that does not belong to its manifest.

    Args:
        folder: Results folder.
        error: Reason why the table cannot be used.

    Returns:
        The error, with the remedy in its message.
    """
    remedy = "restore it, or run the evaluation again"
    return UsageError(f"{folder / EPISODES} cannot be read as the run of {manifests.NAME}: {error}; {remedy}")
