"""Files with the observation statistics (VecNormalize) of a Stable-Baselines3 model, by their names and folders."""

import itertools
import os
import re
from pathlib import Path

from policies.base import PolicyError

STATISTICS_NAMES = "vecnormalize.pkl", "vec_normalize.pkl"
"""Usual names of statistics files."""
BEST_MODEL_FOLDERS = "best_model", "best", "best_models", "eval"
"""Folders of a run's best model; its statistics lie in the run's folder under any name."""
MAX_FOLDERS = 1000
"""Largest number of entries of a model's folder that are searched for folders with statistics."""
_STATISTICS_NAME = re.compile(r"normali[sz]e|vec_?norm")
"""Part of other names of statistics files."""


def find_statistics(model: Path) -> tuple[Path | None, bool]:
    """Find the VecNormalize file of a model.

    Stable-Baselines3's `CheckpointCallback` puts `PREFIX_vecnormalize_N_steps.pkl` next to `PREFIX_N_steps.zip`.
    `EvalCallback` has its own folder for `best_model.zip`; the statistics lie in the run's folder above it. RL Zoo puts
    them into the folder `ENV` next to `ENV.zip` and `best_model.zip`.

    Args:
        model: File of the model.

    Returns:
        file: The statistics; None without any.
        is_certain: True if the file's name and place belong to this model alone.

    Raises:
        PolicyError: Files near the model may be the statistics of another model.
    """
    start, _, end = model.stem.rpartition("_steps")[0].rpartition("_")
    own_names = [f"{model.stem}_vecnormalize.pkl", f"{start}_vecnormalize_{end}_steps.pkl"]
    own_files = [model.parent / name for name in (*own_names, *STATISTICS_NAMES)]
    own_files += [model.with_suffix("") / name for name in STATISTICS_NAMES]
    existing = [file for file in own_files if file.is_file()]
    if existing:
        return existing[0], True
    neighbours = _statistics_in(model.parent)
    candidates = _statistics_in_subfolders(model.parent) or _statistics_above(model)
    if not neighbours and len(candidates) == 1:
        return candidates[0], False
    if not candidates and model.parent.name in BEST_MODEL_FOLDERS:  # those of the run's checkpoints
        candidates = _statistics_in_subfolders(model.parent.parent)
    if neighbours or candidates:
        names = ", ".join(os.path.relpath(file, model.parent) for file in neighbours or candidates)
        raise PolicyError(
            f"{model} may be trained on normalised observations: next to it is {names}; rename the one "
            f"that belongs to it to {own_names[0]}, or move the model into a folder of its own"
        )
    return None, True


def _statistics_above(model: Path) -> list[Path]:
    """Return the statistics in the folder above the model's."""
    folder = model.parent.parent
    files = _statistics_in(folder) if model.parent.name in BEST_MODEL_FOLDERS else []
    return files + [
        folder / name for name in STATISTICS_NAMES if (folder / name).is_file() and folder / name not in files
    ]


def _statistics_in_subfolders(folder: Path) -> list[Path]:
    """Return the statistics in the first folders in a folder, by name."""
    entries = itertools.islice(folder.iterdir(), MAX_FOLDERS)
    subfolders = sorted(entry for entry in entries if entry.is_dir())
    return [file for subfolder in subfolders for file in _statistics_in(subfolder)]


def _statistics_in(folder: Path) -> list[Path]:
    """Return the files in a folder that may be a VecNormalize; its `save` adds no suffix to a name."""
    return sorted(
        file
        for file in folder.glob("*")
        if _STATISTICS_NAME.search(file.name.lower()) and file.suffix in ("", ".pkl", ".pickle") and file.is_file()
    )
