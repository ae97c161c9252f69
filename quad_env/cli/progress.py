"""Live progress on stderr with the time left: a bar on a terminal, one line a finished cell elsewhere."""

import contextlib
import itertools
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from quad_env.cli.interrupt import Interrupt

QUIET = 5.0
"""s. Time before the first line of progress where there is no terminal."""
PERIOD = 10.0
"""s. Time between two of these lines."""
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
            left = (
                f"{format_duration(elapsed * (total - done) / advance)} left" if advance > 0.0 and done < total else ""
            )
            progress.update(task, description=f"{scenario}: {policy}", completed=done, left=left)
            if share < 1.0 or console.is_terminal:
                return
            took = format_duration(elapsed) + (left and f", about {left}")
            _say(f"[{next(finished)}/{total}] {scenario}: {policy} ({took})")

        yield show


def format_duration(seconds: float) -> str:
    """`8 s`, `3 min 20 s`, `2 h 5 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


@contextmanager
def show_bar(what: str, *, in_lines: bool = True) -> Iterator[Callable[[float], None]]:
    """Show the progress of some work; the result takes the share that is done, 0 … 1.

    The display is a bar on a terminal. Elsewhere it is a line after QUIET seconds and then every PERIOD seconds, if
    `in_lines`. A report raises KeyboardInterrupt after Ctrl-C.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    begun = time.perf_counter()
    columns = (
        TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip
    shown = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with Interrupt() as interrupt, shown as progress:
        task = progress.add_task(what, total=1.0)
        due = QUIET

        def report(share: float) -> None:
            nonlocal due
            interrupt.check()
            progress.update(task, completed=share)
            elapsed = time.perf_counter() - begun
            if console.is_terminal or not in_lines or elapsed < due:
                return
            due = elapsed + PERIOD
            left = f", about {format_duration(elapsed * (1.0 - share) / share)} left" if 0.0 < share < 1.0 else ""
            _say(f"{what}: {100.0 * share:.0f} % ({format_duration(elapsed)}{left})")

        yield report


@contextmanager
def show_waiting(what: str) -> Iterator[None]:
    """Show that work of unknown duration goes on: a spinner on a terminal, else a line after QUIET seconds."""
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_terminal:
        with console.status(what):
            yield
        return
    timer = threading.Timer(QUIET, _say, (f"{what} …",))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _say(line: str) -> None:
    with contextlib.suppress(OSError):  # a log that cannot be written is no reason to lose the work
        print(line, file=sys.stderr, flush=True)
