"""Seams of the product that several tests use, each named once: episode length, the report, deadlines, validation."""

from collections.abc import Callable
from typing import Any

import pytest

from evaluate.commands import outputs
from evaluate.rollouts import rollout
from policies.external import process
from quad_env.cli.child_process import RunClock


def short_episodes(patch: pytest.MonkeyPatch, steps: int) -> None:
    """Give the evaluator's episodes that many control steps."""
    patch.setattr(rollout, "STEPS", steps)


def without_report(patch: pytest.MonkeyPatch) -> None:
    """Leave out report.html, whose plots take longer than the episodes of a test."""
    replace_report(patch, lambda *_, **__: None)


def replace_report(patch: pytest.MonkeyPatch, write: Callable[..., Any]) -> None:
    """Call `write` in place of the function that writes report.html."""
    patch.setattr(outputs, "write_report", write)


def deadlines(patch: pytest.MonkeyPatch, act: float | None = None, grace: float | None = None) -> None:
    """Set the deadline of an action and the time until a late process is killed, s."""
    if act is not None:
        patch.setattr(process, "ACT_DEADLINE", act)
    if grace is not None:
        patch.setattr(process, "KILL_GRACE_PERIOD", grace)


def without_processor_wait(patch: pytest.MonkeyPatch) -> None:
    """Count all time as waiting for a processor, as on a machine that is busy."""
    patch.setattr(RunClock, "elapsed", lambda clock: 0.0)
