"""A run's folder: what it holds, by name, and one run at a time in it."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from quad_env.cli.command_line import UsageError
from quad_env.files.writing import FolderInUse, exclusive_lock, make_writable_folder

CONFIG_FILE, RECORD_FILE = "config.json", "run.json"
"""Settings of the run; the command that repeats it, with revision and packages of each session."""
METRICS_FILE, TENSORBOARD = "metrics.jsonl", "tensorboard"
"""Figures of each rollout, a line each; the same as TensorBoard's events."""
VALIDATIONS_FILE, CURVE_FILE = "validations.json", "learning_curve.svg"
"""Every validation, and which was the best; their success and cost of transport as a picture."""
CHECKPOINTS, BEST, LAST = "checkpoints", "best", "last"
"""Resumable states, the bundle of the best validation, the latest bundle."""


def has_checkpoint(folder: Path) -> bool:
    """Whether there is a checkpoint, complete or not."""
    return any((folder / CHECKPOINTS).glob("*.json"))


def steps_done(folder: Path) -> int:
    """Steps at the last checkpoint; 0 without one."""
    return max((int(path.stem) for path in (folder / CHECKPOINTS).glob("*.json")), default=0)


def refuse_folder_in_use(folder: Path) -> None:
    """Raise UsageError unless a run can start in `folder`: a new one, an empty one, or what is left by a run that was
    stopped before its first step."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UsageError(f"{folder} is a file: name a folder with --out")
    if steps_done(folder):
        raise UsageError(f"{folder} holds a run: choose another --out, or continue that run with --resume")
    left = CONFIG_FILE, RECORD_FILE, METRICS_FILE, TENSORBOARD, CHECKPOINTS, *[LAST] * has_checkpoint(folder)
    halves = tuple(f".{name}." for name in left)  # of files that were being written
    if any(entry.name not in left and not entry.name.startswith(halves) for entry in folder.iterdir()):
        raise UsageError(f"{folder} is not empty: choose another --out")


@contextlib.contextmanager
def new_run_folder(folder: Path) -> Iterator[None]:
    """Context in which `folder`, made if need be, is used by one new run. Raises UsageError where it cannot be."""
    with report_write_errors(folder):
        make_writable_folder(folder)
        with exclusive_lock(folder):
            refuse_folder_in_use(folder)  # another run may have come and gone since the first check
            yield


@contextlib.contextmanager
def report_write_errors(folder: Path) -> Iterator[None]:
    """Context in which a failure to write is a UsageError with a remedy."""
    try:
        yield
    except FolderInUse:
        raise
    except OSError as error:
        kept = has_checkpoint(folder)
        remedy = "make room, then continue the run with --resume" if kept else "choose another --out"
        raise UsageError(f"cannot write into {folder} ({error.strerror or error}): {remedy}") from None
