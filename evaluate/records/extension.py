"""Extension of a finished evaluation (run) by policies or episodes; its episodes are kept."""

from pathlib import Path

import numpy as np

from evaluate.cells import EpisodeChunk
from evaluate.records.manifest import Manifest
from evaluate.records.store import ChunkStore, read_run


def extend_run(folder: Path, manifest: Manifest) -> int:
    """Turn a finished run into an unfinished run with further policies or episodes.

    The episodes of the finished run become chunks (files with a subset of the episodes) of the extended run, so that
    only the missing episodes are simulated. The manifest is written last: if the process is killed before, the folder
    still holds the finished run. OSError is raised if a file cannot be written.

    Args:
        folder: Results folder of the finished run.
        manifest: All inputs of the extended run.

    Returns:
        Number of episodes that are kept.
    """
    run = read_run(folder)
    store = ChunkStore(folder, manifest, resumed=True)
    for cell in run.cells:
        store.save(EpisodeChunk(np.arange(cell.episodes), cell))
    manifest.write(folder)
    return sum(cell.episodes for cell in run.cells)
