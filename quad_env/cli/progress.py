"""Live progress on stderr with the time left: a bar on a terminal, one line a finished cell elsewhere."""

import contextlib
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from quad_env.cli.interrupt import Interrupt

CellProgress: TypeAlias = Callable[[str, str, float], None]
"""Takes the policy and the scenario of a cell, and the share of it that is done, 0 to 1; 1 exactly once."""


@contextmanager
def show_progress(total: int) -> Iterator[CellProgress]:
    """A callback that shows how far a comparison of so many cells is, and how long the rest takes at the pace so far.

    Several cells may be under way. What is done at a cell's first report was kept by an earlier run and took no time.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    console, begun, finished = Console(stderr=True), time.perf_counter(), itertools.count(1)
    kept: dict[tuple[str, str], float] = {}
    shares: dict[tuple[str, str], float] = {}
    what, to_come = TextColumn("{task.description}"), TextColumn("{task.fields[left]}")
    columns = what, BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), to_come
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("starting", total=total, left="")

        def show(policy: str, scenario: str, share: float) -> None:
            kept.setdefault((policy, scenario), share)
            shares[policy, scenario] = share
            done, elapsed = sum(shares.values()), time.perf_counter() - begun
            advance = done - sum(kept.values())
            left = f"{duration(elapsed * (total - done) / advance)} left" if advance > 0.0 and done < total else ""
            progress.update(task, description=f"{scenario}: {policy}", completed=done, left=left)
            if share < 1.0 or console.is_terminal:
                return
            with contextlib.suppress(OSError):  # a log that cannot be written is no reason to lose the run
                took = duration(elapsed) + (left and f", about {left}")
                print(f"[{next(finished)}/{total}] {scenario}: {policy} ({took})", file=sys.stderr, flush=True)

        yield show


def duration(seconds: float) -> str:
    """`8 s`, `3 min 20 s`, `2 h 5 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


@contextmanager
def bar(what: str) -> Iterator[Callable[[float], None]]:
    """Takes the share of the work that is done, 0 … 1: a bar on a terminal, nothing elsewhere.

    It raises KeyboardInterrupt if Ctrl-C was pressed: the work stops between two reports.
    """
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    shown = Progress(console=console, transient=True, disable=not console.is_terminal)
    with Interrupt() as interrupt, shown as progress:
        task = progress.add_task(what, total=1.0)

        def report(share: float) -> None:
            interrupt.check()
            progress.update(task, completed=share)

        yield report
