"""Folder of a training run: names of its files, and the lock that keeps it to one run at a time."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from quad_env.cli.command_line import UsageError
from quad_env.files.writing import FolderInUseError, exclusive_lock, make_writable_folder

CONFIG_FILE = "config.json"
"""Settings of the run."""
RECORD_FILE = "run.json"
"""Command that repeats the run, with revision and packages of each session."""
METRICS_FILE = "metrics.jsonl"
"""Figures of each rollout, one line each."""
TENSORBOARD = "tensorboard"
"""Folder of the same figures as TensorBoard's events."""
VALIDATIONS_FILE = "validations.json"
"""All validations, and the steps of the best."""
CURVE_FILE = "learning_curve.svg"
"""Picture of success and cost of transport over the validations."""
CHECKPOINTS = "checkpoints"
"""Folder of the states that a run can resume from."""
BEST = "best"
"""Folder of the bundle of the best validation."""
LAST = "last"
"""Folder of the latest bundle."""


def has_checkpoint(folder: Path) -> bool:
    """Return True if there is a checkpoint, complete or not."""
    return any((folder / CHECKPOINTS).glob("*.json"))


def steps_done(folder: Path) -> int:
    """Return the steps at the last checkpoint; 0 without one."""
    return max((int(path.stem) for path in (folder / CHECKPOINTS).glob("*.json")), default=0)


def refuse_folder_in_use(folder: Path) -> None:
    """Check that a new run can start in a folder.

    It can if the folder is new, empty, or left by a run that was stopped before its first step.

    Args:
        folder: Folder of the run.

    Raises:
        UsageError: It cannot.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UsageError(f"{folder} is a file: name a folder with --out")
    if steps_done(folder):
        raise UsageError(f"{folder} holds a run: choose another --out, or continue that run with --resume")
    allowed = [CONFIG_FILE, RECORD_FILE, METRICS_FILE, TENSORBOARD, CHECKPOINTS]
    if has_checkpoint(folder):
        allowed.append(LAST)
    temporary = tuple(f".{name}." for name in allowed)  # files that were being written
    if any(entry.name not in allowed and not entry.name.startswith(temporary) for entry in folder.iterdir()):
        raise UsageError(f"{folder} is not empty: choose another --out")


@contextlib.contextmanager
def new_run_folder(folder: Path) -> Iterator[None]:
    """Make the folder of a new run and lock it. Raises UsageError if it cannot be used."""
    with report_write_errors(folder):
        make_writable_folder(folder)
        with exclusive_lock(folder):
            refuse_folder_in_use(folder)  # another run may have come and gone since the first check
            yield


@contextlib.contextmanager
def report_write_errors(folder: Path) -> Iterator[None]:
    """Turn a failure to write into `folder` into a UsageError with a remedy."""
    try:
        yield
    except FolderInUseError:
        raise
    except OSError as error:
        can_resume = has_checkpoint(folder)
        remedy = "make room, then continue the run with --resume" if can_resume else "choose another --out"
        raise UsageError(f"cannot write into {folder} ({error.strerror or error}): {remedy}") from None
