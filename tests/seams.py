"""Patches of the product that several tests use: simulation, files, report, validation, deadlines."""

import errno
import os
from collections.abc import Callable
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest

from evaluate.commands import outputs
from evaluate.rollouts import rollout
from policies.external import process
from quad_env.cli.child_process import RunClock


def short_episodes(patch: pytest.MonkeyPatch, steps: int) -> None:
    """Give the evaluator's episodes `steps` control steps."""
    patch.setattr(rollout, "STEPS", steps)


def replace_simulation(patch: pytest.MonkeyPatch, simulate: Callable[..., Any]) -> None:
    """Call `simulate` in place of the function that simulates the episodes of the evaluator."""
    patch.setattr(rollout, "run_scenarios", simulate)


def full_disk(patch: pytest.MonkeyPatch, *names: str) -> None:
    """Let atomic writes of files fail with "No space left on device"; `names`: patterns of the file names."""
    replace = Path.replace

    def fail(temporary: Path, target: Path) -> Path:
        if any(fnmatch(Path(target).name, name) for name in names):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return replace(temporary, target)

    patch.setattr(Path, "replace", fail)


def without_report(patch: pytest.MonkeyPatch) -> None:
    """Leave out report.html, whose plots take longer than the episodes of a test."""
    replace_report(patch, lambda *_, **__: None)


def replace_report(patch: pytest.MonkeyPatch, write: Callable[..., Any]) -> None:
    """Call `write` in place of the function that writes report.html."""
    patch.setattr(outputs, "write_report", write)


def replace_validation(patch: pytest.MonkeyPatch, validate: Callable[..., Any]) -> None:
    """Call `validate` in place of the function with which a training run validates its policy."""
    from train.sb3 import callbacks  # a local import, because torch takes seconds to import

    patch.setattr(callbacks, "validate", validate)


def deadlines(patch: pytest.MonkeyPatch, act: float | None = None, grace: float | None = None) -> None:
    """Set the deadline of an action and the time until a late process is killed, s."""
    if act is not None:
        patch.setattr(process, "ACT_DEADLINE", act)
    if grace is not None:
        patch.setattr(process, "KILL_GRACE_PERIOD", grace)


def without_processor_wait(patch: pytest.MonkeyPatch) -> None:
    """Count all time as waiting for a processor, as on a busy machine."""
    patch.setattr(RunClock, "elapsed", lambda clock: 0.0)
