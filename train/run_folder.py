"""What a run's folder holds, by name, and whether a run can be begun or carried on there."""

from pathlib import Path

from evaluate.terminal.command_line import UsageError

CONFIG_FILE = "config.json"
"""The run's settings."""
CHECKPOINTS, BEST, LAST = "checkpoints", "best", "last"
"""Resumable states, the bundle with the best validation score, the latest bundle."""
TENSORBOARD = "tensorboard"
"""TensorBoard's events."""


def has_checkpoint(folder: Path) -> bool:
    """Whether --resume has something to look at; whether it is whole shows when it is read."""
    return any((folder / CHECKPOINTS).glob("*.json"))


def refuse_folder_in_use(folder: Path) -> None:
    """Raise UsageError unless a run can be begun in `folder`: one that is not there yet, or holds nothing to lose.

    The latter is what a run leaves that was stopped before its first checkpoint: settings and a log.
    """
    if not folder.exists():
        return
    if has_checkpoint(folder):
        raise UsageError(f"{folder} holds a run: choose another --out, or carry that run on with --resume")
    if not folder.is_dir() or {entry.name for entry in folder.iterdir()} - {CONFIG_FILE, TENSORBOARD}:
        raise UsageError(f"{folder} is not empty: choose another --out")
