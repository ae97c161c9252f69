"""Folder of a training run: defines the names of its files, and makes, checks and locks the folder.

The lock prevents that two processes train in the same folder.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from evaluate.records import training_run
from quad_env.cli.command_line import UsageError
from quad_env.files.writing import FolderInUseError, exclusive_lock, make_writable_folder

CONFIG_FILE = training_run.SETTINGS_FILE
"""Name of the JSON file with the settings of a training run."""
RECORD_FILE = "run.json"
"""Name of the JSON file with the command line that repeats a training run.

The file also lists the revision of the source code and the package versions of each session. A session is the part of a
run that one process trains."""
METRICS_FILE = "metrics.jsonl"
"""Name of the file with the training metrics, one line of JSON per rollout."""
TENSORBOARD = "tensorboard"
"""Name of the folder with the training metrics as TensorBoard events."""
VALIDATIONS_FILE = training_run.VALIDATIONS_FILE
"""Name of the JSON file with the results of all validations, and the number of steps at the best validation."""
CURVE_FILE = "learning_curve.svg"
"""Name of the image file with the plot of success and cost of transport over all validations."""
CHECKPOINTS = "checkpoints"
"""Name of the folder with the checkpoints, from which a stopped training run can be resumed."""
BEST = "best"
"""Name of the folder of the policy bundle with the best validation result of the run."""
LAST = "last"
"""Name of the folder of the policy bundle that was saved last in the run, with each checkpoint."""


def has_checkpoint(folder: Path) -> bool:
    """Return True if the folder of a training run has a checkpoint, even a damaged one."""
    return any((folder / CHECKPOINTS).glob("*.json"))


def steps_done(folder: Path) -> int:
    """Return the number of learner steps (or labels) at the last checkpoint in a run folder; 0 if there is none."""
    return max((int(path.stem) for path in (folder / CHECKPOINTS).glob("*.json")), default=0)


def refuse_folder_in_use(folder: Path) -> None:
    """Check that a new training run can start in a folder, and raise UsageError if not.

    The folder must be missing, empty, or left by a run that was stopped before its first step.

    Args:
        folder: Folder of the run.

    Raises:
        UsageError: The path is a file, or the folder contains a run or other files.
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
    temporary = tuple(f".{name}." for name in allowed)  # Prefixes of temporary files
    if any(entry.name not in allowed and not entry.name.startswith(temporary) for entry in folder.iterdir()):
        raise UsageError(f"{folder} is not empty: choose another --out")


@contextlib.contextmanager
def new_run_folder(folder: Path) -> Iterator[None]:
    """Make the folder of a new training run, and lock it against other processes during the `with` block.

    Raises UsageError if the folder is in use, has other files, or cannot be written.
    """
    with report_write_errors(folder):
        make_writable_folder(folder)
        with exclusive_lock(folder):
            # The folder is checked again, because another run may have started in it since the first check.
            refuse_folder_in_use(folder)
            yield


@contextlib.contextmanager
def report_write_errors(folder: Path) -> Iterator[None]:
    """Convert an OSError within the context to a UsageError that says how the run in `folder` can be continued."""
    try:
        yield
    except FolderInUseError:
        raise
    except OSError as error:
        can_resume = has_checkpoint(folder)
        remedy = "make room, then continue the run with --resume" if can_resume else "choose another --out"
        raise UsageError(f"cannot write into {folder} ({error.strerror or error}): {remedy}") from None
