"""Results folder of one part of an evaluation (`--part`): its manifest.json and the episodes of its share."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from evaluate.cells import EpisodeChunk, PolicyScenarioResult, evaluation_seeds, join
from evaluate.records import manifest as manifests
from evaluate.records.episode_table import cell_of, concatenate, missing_measures, read_table, table, write_table
from evaluate.records.manifest import FILES, Manifest
from evaluate.records.shares import Share
from evaluate.records.store import EPISODES, Run, is_unfinished, rows_of
from quad_env.cli.command_line import UsageError


@dataclass(frozen=True)
class StoredPart:
    """One finished part of an evaluation, as read from its folder."""

    folder: Path
    manifest: Manifest
    """All inputs of the whole evaluation, and the share of this part."""
    share: Share
    """Episodes of this part."""
    rows: pa.Table
    """Table with one row per episode of this part; empty, without columns, if the part has no episodes."""


def write_part(run: Run, folder: Path) -> None:
    """Write the files of a finished part of an evaluation.

    Other result files of an earlier run in the folder are removed. OSError is raised if a file cannot be written.

    Args:
        run: Finished part: the results of all of its episodes.
        folder: Folder of the part.
    """
    for name in FILES:
        if name not in (EPISODES, manifests.NAME):
            (folder / name).unlink(missing_ok=True)
    run.manifest.write(folder)
    tables = [table(cell, run.manifest.episode_indices(cell.scenario.name)) for cell in run.cells]
    if tables:
        write_table(concatenate(tables), folder / EPISODES, run.manifest.fingerprint)
    else:
        (folder / EPISODES).unlink(missing_ok=True)


def read_part(folder: Path) -> StoredPart:
    """Read a finished part of an evaluation, and check that it has exactly the episodes of its share.

    Args:
        folder: Folder of the part.

    Returns:
        The part.

    Raises:
        UsageError: The folder has no part, the part is not finished, or a file is damaged or was changed. The message
            starts with the folder.
    """
    manifest = manifests.read(folder)
    if manifest.share is None:
        raise UsageError(f"{folder} holds no part of a run, but a run without --part")
    if not manifest.cells:
        return StoredPart(folder, manifest, manifest.share, pa.table({}))
    if is_unfinished(folder) or not (folder / EPISODES).is_file():
        remedy = f"python -m evaluate --resume --out {shlex.quote(str(folder))}"
        raise UsageError(f"{folder} holds part {manifest.share.part}, which is not finished; go on: {remedy}")
    try:
        rows = read_table(folder / EPISODES, manifest.fingerprint)
        _check_rows(rows, manifest)
    except (KeyError, TypeError, ValueError) as error:
        message = f"{folder} holds part {manifest.share.part}, which cannot be read: {error}; simulate it again"
        raise UsageError(message) from error
    return StoredPart(folder, manifest, manifest.share, rows)


def _check_rows(rows: pa.Table, manifest: Manifest) -> None:
    """Check that a table has exactly the episodes of a part of an evaluation, in their order and with their seeds.

    Args:
        rows: Table with one row per episode.
        manifest: Manifest of the part.

    Raises:
        ValueError: A row is missing, is not expected, or has another seed, or a measure is missing.
    """
    seeds = evaluation_seeds(manifest.seed, manifest.episodes)
    expected = [
        (scenario.name, policy, int(index), int(seeds[index]))
        for scenario, policy in manifest.cells
        for index in manifest.episode_indices(scenario.name)
    ]
    columns = ("scenario", "policy", "episode", "seed")
    if list(zip(*(rows.column(name).to_pylist() for name in columns), strict=True)) != expected:
        raise ValueError(f"the rows of {EPISODES} are not the episodes of this part")
    if missing := missing_measures(rows):
        raise ValueError(f"{EPISODES} has no column {', '.join(missing)}")


def join_parts(parts: Sequence[StoredPart], manifest: Manifest) -> Run:
    """Join the episodes of all parts of an evaluation.

    Args:
        parts: Parts, in any order. No two of them have an episode in common, and together they have all episodes.
        manifest: Manifest of the whole evaluation.

    Returns:
        The run, with the results in the order of the evaluation.
    """
    cells: list[PolicyScenarioResult] = []
    for scenario, policy in manifest.cells:
        chunks = []
        for part in parts:
            if not len(indices := part.share.episode_indices(scenario.name)):
                continue
            chunks.append(EpisodeChunk(indices, cell_of(rows_of(part.rows, policy, scenario.name), scenario)))
        cells.append(join(chunks))
    return Run(manifest, tuple(cells))


def gaps_and_overlaps(parts: Sequence[StoredPart], manifest: Manifest) -> list[str]:
    """Describe the episodes that no part has, and the episodes that several parts have.

    Args:
        parts: Parts of the evaluation.
        manifest: Manifest of the whole evaluation.

    Returns:
        A text for each scenario with missing episodes and for each scenario with episodes in several parts.
    """
    texts = []
    for scenario in dict.fromkeys(scenario.name for scenario, _ in manifest.cells):
        indices = np.concatenate([part.share.episode_indices(scenario) for part in parts])
        counts = np.bincount(indices, minlength=manifest.episodes)
        if missing := np.flatnonzero(counts == 0).tolist():
            texts.append(f"no part has {_episodes(missing)} of {scenario}")
        if doubled := np.flatnonzero(counts > 1).tolist():
            folders = [str(part.folder) for part in parts if {*part.share.episode_indices(scenario)} & {*doubled}]
            texts.append(f"{' and '.join(folders)} have both {_episodes(doubled)} of {scenario}")
    return texts


def _episodes(indices: Sequence[int]) -> str:
    """Return text for a list of episode indices, such as `episodes 3 to 7`."""
    if len(indices) == 1:
        return f"episode {indices[0]}"
    return f"episodes {indices[0]} to {indices[-1]}"
