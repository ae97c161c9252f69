"""Live progress on stderr: a bar on a terminal, one line a finished cell elsewhere."""

import contextlib
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evaluate.experiment import CellProgress


@contextmanager
def show_progress(total_cells: int) -> "Iterator[CellProgress]":
    """A callback that shows how far the comparison is."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines(total_cells)
        return
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, TextColumn("left"), TimeRemainingColumn(), console=console, transient=True) as progress:
        task = progress.add_task("starting", total=total_cells)
        finished = 0

        def show(policy: str, scenario: str, share: float) -> None:
            nonlocal finished
            progress.update(task, description=f"{scenario}: {policy}", completed=finished + share)
            finished += share >= 1.0

        yield show


class _Lines:
    """One line a finished cell, for logs."""

    def __init__(self, total_cells: int) -> None:
        self.total_cells = total_cells
        self.finished = 0
        self.start = time.perf_counter()

    def __call__(self, policy: str, scenario: str, share: float) -> None:
        if share < 1.0:
            return
        self.finished += 1
        elapsed = time.perf_counter() - self.start
        line = f"[{self.finished}/{self.total_cells}] {scenario}: {policy} ({elapsed:.0f} s)"
        with contextlib.suppress(OSError):  # a log that cannot be written is no reason to lose the run
            print(line, file=sys.stderr, flush=True)
