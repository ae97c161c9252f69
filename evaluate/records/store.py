"""Results folder of an evaluation (run): saves measured episodes during the run, and reads them back.

A cell is the result of one policy on one scenario. A chunk is a subset of its episodes that are simulated together and
stored in one file, until the run is finished.
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
"""Name of the file in a results folder with the measures of all episodes of a finished evaluation."""
_CHUNK = re.compile(r"\d{5}-\d{7}(-[0-9a-f]{8})?\.parquet")
"""Pattern of the file name of a chunk (subset of episodes that are simulated together).

The name contains the index of the policy-scenario pair and the index of the first episode. The first eight characters
of the fingerprint (hash of all inputs) of the evaluation follow.
"""
_FIRST_EPISODE = slice(6, 13)
"""Positions of the digits in a chunk's file name that are the index of its first episode.

A chunk is a subset of episodes that are simulated together and stored in one file.
"""
_TEMPORARY = re.compile(rf"\.({'|'.join(map(re.escape, FILES))}|{_CHUNK.pattern})\..{{8}}")
"""Pattern of the name of a temporary file that remains if an evaluation is killed during writing."""


@dataclass(frozen=True)
class Run:
    """A finished or unfinished evaluation, as read from its results folder."""

    manifest: Manifest
    """All inputs of the evaluation, as read from manifest.json."""
    cells: tuple[PolicyScenarioResult, ...]
    """Results of the policy-scenario pairs that have all episodes, in the order of the evaluation."""
    stored: bool = False
    """True if the results are from episodes.parquet, the file that an evaluation writes at its end.

    False if they are from the separate files of an unfinished evaluation.
    """
    missing_measures: tuple[str, ...] = ()
    """Names of the measures that the file episodes.parquet lacks; their values in `cells` are NaN or None."""

    @property
    def complete(self) -> bool:
        """True if every policy-scenario pair has all episodes and no further episodes will be added."""
        return len(self.cells) == len(self.manifest.cells) and not self.manifest.is_unsettled


class ChunkStore:
    """Store of the finished episodes of an unfinished evaluation, from which it can be resumed.

    The episodes are stored in chunks in the results folder. A chunk is a subset of the episodes of one policy on one
    scenario. Each chunk is one file, which is written atomically.

    Args:
        folder: Results folder of the evaluation.
        manifest: All inputs of the evaluation.
        resumed: True if the folder already contains episodes of this evaluation; False for a new evaluation.
    """

    def __init__(self, folder: Path, manifest: Manifest, resumed: bool = False) -> None:
        self.folder = folder
        self.manifest = manifest
        self.begun = resumed
        """True if the content of the results folder belongs to this evaluation.

        It is False until the first episodes of a new evaluation are saved. Until then, the folder can still contain the
        results of an earlier evaluation.
        """
        self._policies = list(manifest.policies)

    def load(self, policy: str, scenario: Scenario) -> Sequence[EpisodeChunk]:
        """Read the stored chunks (subsets of episodes) of one policy on one scenario.

        Damaged files, and files of another evaluation or with other seeds, are skipped.

        Args:
            policy: Label of the policy.
            scenario: Scenario of the episodes.

        Returns:
            Chunks, in the order of their first episodes. No two of them have an episode in common.
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
        """Write a chunk, a subset of the episodes of one policy on one scenario, into one file.

        The first chunk of a new evaluation replaces the manifest and all chunks of an earlier evaluation in the folder.
        OSError is raised if the file cannot be written.

        Args:
            chunk: The episodes with their measures.
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
        """Return the index of the pair of `policy`, a label, and `scenario` in the order of the evaluation."""
        return self.manifest.scenarios.index(scenario) * len(self._policies) + self._policies.index(policy)

    def _read(self, path: Path, scenario: Scenario) -> EpisodeChunk | None:
        """Read a stored chunk: a subset of the episodes of one policy on one scenario.

        Args:
            path: File of the chunk.
            scenario: Scenario of the episodes.

        Returns:
            The chunk; None if the file is damaged, belongs to another evaluation, or has other seeds.
        """
        try:
            rows = read_table(path, self.manifest.fingerprint)
            chunk = EpisodeChunk(rows.column("episode").to_numpy(), cell_of(rows, scenario))
            seeds = evaluation_seeds(self.manifest.seed, self.manifest.episodes)
            return chunk if np.array_equal(seeds[chunk.episode_indices], chunk.cell.seeds) else None
        except (LookupError, OSError, ValueError):
            return None


def read_run(folder: Path) -> Run:
    """Read manifest and results of the finished or unfinished evaluation in a results `folder`.

    UsageError or OSError is raised if the evaluation cannot be read.
    """
    manifest, rows, stored = _read(folder)
    try:
        return Run(manifest, tuple(_cells(manifest, rows)), stored, tuple(missing_measures(rows)))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _unreadable(folder, error) from error


def read_rows(folder: Path) -> tuple[Manifest, pa.Table]:
    """Read the manifest (all inputs) and the table of the finished episodes in a results folder.

    UsageError or OSError is raised if they cannot be read.

    Args:
        folder: Results folder.

    Returns:
        Manifest, and table with one row per episode. It contains the policy-scenario pairs that have all episodes.
    """
    manifest, rows, _ = _read(folder)
    return manifest, rows


def _read(folder: Path) -> tuple[Manifest, pa.Table, bool]:
    """Read the manifest (all inputs) and the table of the finished episodes in a results `folder`.

    The table has one row per episode. The third value is True if the rows are from episodes.parquet, and False if they
    are from the files of an unfinished evaluation. UsageError or OSError is raised if the evaluation cannot be read.
    """
    manifest = manifests.read(folder)
    if manifest.share is not None:
        fact = f"{folder} holds only part {manifest.share.part} of a run"
        raise UsageError(f"{fact}; put all parts together: python -m evaluate merge FOLDERS")
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
    """Read the table episodes.parquet, and check that it contains exactly the episodes of its evaluation.

    If the file lacks a measure, the values of this measure are null, and its name is printed on stderr.

    Args:
        path: Path of episodes.parquet.
        manifest: All inputs of the evaluation.

    Returns:
        Table with one row per episode, in the order of the evaluation. It is empty if the file does not exist. After an
        interruption, some policy-scenario pairs have no rows.

    Raises:
        ValueError: The file was changed or belongs to another evaluation, its rows are not the expected episodes in
            order, or a required column is missing.
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
    """Return the rows of a table of episodes that belong to one policy on one scenario.

    Args:
        rows: Table with one row per episode.
        policy: Label of the policy.
        scenario: Name of the scenario.

    Returns:
        Table with the selected rows.
    """
    return rows.filter((pc.field("policy") == policy) & (pc.field("scenario") == scenario))


def is_unfinished(folder: Path) -> bool:
    """Return True if a results `folder` contains an unfinished evaluation: manifest.json and chunks.

    A chunk is a subset of episodes that are simulated together and stored in one file.
    """
    return (folder / manifests.NAME).is_file() and any(_chunk_files(folder))


def remove_chunks(folder: Path, but: str = "") -> None:
    """Remove all stored chunks (files with a subset of the episodes) from a results folder.

    Temporary files that a killed evaluation left behind are removed as well.

    Args:
        folder: Results folder. All other files in it are kept.
        but: Name of the file of one chunk that is kept; empty to remove all chunks.
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
    except OSError:  # The subfolder does not exist, or it contains other files.
        return


def _chunk_files(folder: Path) -> Iterator[Path]:
    """Yield the paths of all stored chunks (subsets of episodes) in a results `folder`, of any evaluation."""
    return (path for path in (folder / CHUNKS).glob("*.parquet") if _CHUNK.fullmatch(path.name))


def _from_chunks(store: ChunkStore) -> Iterator[PolicyScenarioResult]:
    """Read the results of an unfinished evaluation from its chunks (files with a subset of the episodes).

    The number of files that are damaged or belong to another evaluation is printed on stderr.

    Args:
        store: Store of the chunks in the results folder.

    Yields:
        Result of each policy-scenario pair for which all episodes are stored, in the order of the evaluation.
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
    """Convert the table of all episodes of an evaluation to one result for each policy-scenario pair.

    Args:
        manifest: All inputs of the evaluation, with its policies and scenarios.
        rows: Table with one row per episode.

    Yields:
        Results of the policy-scenario pairs that have rows, in the order of the evaluation.
    """
    if not rows.num_rows:
        return
    for scenario, policy in manifest.cells:
        cell_rows = rows_of(rows, policy, scenario.name)
        if cell_rows.num_rows:
            yield cell_of(cell_rows, scenario)


def _unreadable(folder: Path, error: Exception) -> UsageError:
    """Make the error for a file episodes.parquet that does not match the manifest.json in its folder.

    Args:
        folder: Results folder with both files.
        error: Error that contains the reason.

    Returns:
        The error for the user, with the remedy in its message.
    """
    remedy = "restore it, or run the evaluation again"
    return UsageError(f"{folder / EPISODES} cannot be read as the run of {manifests.NAME}: {error}; {remedy}")
