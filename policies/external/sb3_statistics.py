"""Search for the file with the observation statistics (VecNormalize) of a Stable-Baselines3 model.

The statistics are the mean and variance of the observations in training, with which each observation is normalised.
"""

import itertools
import os
import re
from pathlib import Path

from policies.base import PolicyError

STATISTICS_NAMES = "vecnormalize.pkl", "vec_normalize.pkl"
"""Usual names of files with observation statistics (VecNormalize)."""
BEST_MODEL_FOLDERS = "best_model", "best", "best_models", "eval"
"""Names of folders in which training scripts save the best model of a training run.

The file of the observation statistics is then in the parent folder and can have any name.
"""
MAX_FOLDERS = 1000
"""Maximum number of directory entries that are searched for subfolders with statistics files."""
_STATISTICS_NAME = re.compile(r"normali[sz]e|vec_?norm")
"""Pattern that a file name in lower case must contain if the file may hold observation statistics."""


def find_statistics(model: Path) -> tuple[Path | None, bool]:
    """Find the file with the observation statistics (VecNormalize) of a Stable-Baselines3 model.

    `CheckpointCallback` of Stable-Baselines3 writes `PREFIX_vecnormalize_N_steps.pkl` next to `PREFIX_N_steps.zip`.
    `EvalCallback` writes `best_model.zip` into its own folder; the statistics are then in the parent folder. RL Zoo
    writes the statistics into the folder `ENV` next to `ENV.zip` and `best_model.zip`.

    Args:
        model: Path of the model's .zip file.

    Returns:
        file: Path of the statistics file; None if there is none.
        is_certain: False if the file was chosen only because it is the only statistics file near the model.

    Raises:
        PolicyError: There are statistics files near the model, but they may belong to another model.
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
    if not candidates and model.parent.name in BEST_MODEL_FOLDERS:
        # The statistics may be in the folder of the checkpoints, which is next to the folder of the best model.
        candidates = _statistics_in_subfolders(model.parent.parent)
    if neighbours or candidates:
        names = ", ".join(os.path.relpath(file, model.parent) for file in neighbours or candidates)
        raise PolicyError(
            f"{model} may be trained on normalised observations: next to it is {names}; rename the one "
            f"that belongs to it to {own_names[0]}, or move the model into a folder of its own"
        )
    return None, True


def _statistics_above(model: Path) -> list[Path]:
    """Return the paths of the observation statistics files in the parent of the model's folder.

    Only files with a usual name (STATISTICS_NAMES) are included. If the model's folder has a usual name of a folder for
    the best model (BEST_MODEL_FOLDERS), files with other names are included, too.
    """
    folder = model.parent.parent
    files = _statistics_in(folder) if model.parent.name in BEST_MODEL_FOLDERS else []
    return files + [
        folder / name for name in STATISTICS_NAMES if (folder / name).is_file() and folder / name not in files
    ]


def _statistics_in_subfolders(folder: Path) -> list[Path]:
    """Return the paths of the observation statistics files in all subfolders of a folder, sorted."""
    entries = itertools.islice(folder.iterdir(), MAX_FOLDERS)
    subfolders = sorted(entry for entry in entries if entry.is_dir())
    return [file for subfolder in subfolders for file in _statistics_in(subfolder)]


def _statistics_in(folder: Path) -> list[Path]:
    """Return the sorted paths of the files in a folder that may be observation statistics (VecNormalize).

    A file without suffix may be one, because `VecNormalize.save` does not add a suffix.
    """
    return sorted(
        file
        for file in folder.glob("*")
        if _STATISTICS_NAME.search(file.name.lower()) and file.suffix in ("", ".pkl", ".pickle") and file.is_file()
    )
