"""Display of progress and remaining time on stderr: a bar on a terminal, otherwise a line at intervals."""

import contextlib
import itertools
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from quad_env.cli.interrupt import Interrupt

FIRST_LINE_TIME = 5.0
"""Time from the start of a task to its first line of progress, s; a terminal shows a bar instead of lines."""
LINE_PERIOD = 10.0
"""Time between two lines of progress, s; a terminal shows a progress bar instead of lines."""
CellProgress: TypeAlias = Callable[[str, str, float], None]
"""Type of a callback that receives the progress of a policy-scenario pair of an evaluation.

The arguments are the name of the policy, the name of the scenario, and the completed fraction of the episodes, 0 to 1.
The callback is called with the fraction 1 exactly once per pair.
"""


@contextmanager
def show_progress(total: int) -> Iterator[CellProgress]:
    """Return a context manager that displays the progress of an evaluation and the remaining time.

    Several policy-scenario pairs may run at once. The first reported fraction of a pair counts as work of an earlier,
    interrupted evaluation, so the estimate of the remaining time ignores this fraction.

    Args:
        total: Number of policy-scenario pairs.

    Yields:
        Callback that must be called when a pair has made progress.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    start = time.perf_counter()
    finished = itertools.count(1)
    earlier: dict[tuple[str, str], float] = {}
    shares: dict[tuple[str, str], float] = {}
    description = TextColumn("{task.description}")
    remaining = TextColumn("{task.fields[left]}")
    columns = (description, BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), remaining)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("starting", total=total, left="")

        def show(policy: str, scenario: str, share: float) -> None:
            """Show that the fraction `share`, 0 to 1, of the episodes of a policy-scenario pair is completed."""
            earlier.setdefault((policy, scenario), share)
            shares[policy, scenario] = share
            done = sum(shares.values())
            elapsed = time.perf_counter() - start
            advance = done - sum(earlier.values())
            left = (
                f"{format_duration(elapsed * (total - done) / advance)} left" if advance > 0.0 and done < total else ""
            )
            progress.update(task, description=f"{scenario}: {policy}", completed=done, left=left)
            if share < 1.0 or console.is_terminal:
                return
            took = format_duration(elapsed) + (left and f", about {left}")
            _print_line(f"[{next(finished)}/{total}] {scenario}: {policy} ({took})")

        yield show


def format_duration(seconds: float) -> str:
    """Format a duration in seconds as `8 s`, `3 min 20 s` or `2 h 5 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


@contextmanager
def show_bar(description: str, *, in_lines: bool = True) -> Iterator[Callable[[float], None]]:
    """Return a context manager that displays the progress of one task, such as a training.

    On a terminal, the progress is a bar. Otherwise, a line is printed after FIRST_LINE_TIME and then every LINE_PERIOD.

    Args:
        description: Name of the task, as the display shows it.
        in_lines: True to print lines if stderr is not a terminal, False to print nothing in this case.

    Yields:
        Callback that must be called with the completed fraction, 0 to 1; it raises KeyboardInterrupt after Ctrl-C.
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
    start = time.perf_counter()
    columns = (
        TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip
    display = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with Interrupt() as interrupt, display as progress:
        task = progress.add_task(description, total=1.0)
        next_line = FIRST_LINE_TIME

        def report(share: float) -> None:
            nonlocal next_line
            interrupt.check()
            progress.update(task, completed=share)
            elapsed = time.perf_counter() - start
            if console.is_terminal or not in_lines or elapsed < next_line:
                return
            next_line = elapsed + LINE_PERIOD
            left = f", about {format_duration(elapsed * (1.0 - share) / share)} left" if 0.0 < share < 1.0 else ""
            _print_line(f"{description}: {100.0 * share:.0f} % ({format_duration(elapsed)}{left})")

        yield report


@contextmanager
def show_waiting(description: str, first_line_time: float = FIRST_LINE_TIME) -> Iterator[None]:
    """Return a context manager that displays the name of a task of unknown duration while the task runs.

    On a terminal, a spinner with the name is shown at once. Otherwise, one line is printed if the task takes longer
    than `first_line_time`.

    Args:
        description: Name of the task, as the display shows it.
        first_line_time: Time from the start of the task to the line, s, if stderr is not a terminal.

    Yields:
        None; the task runs in the `with` block.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_terminal:
        with console.status(description):
            yield
        return
    timer = threading.Timer(first_line_time, _print_line, (f"{description} …",))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _print_line(line: str) -> None:
    """Print `line` on stderr; an error of the output, such as a closed terminal, is ignored."""
    with contextlib.suppress(OSError):  # The task must continue even if its progress cannot be printed.
        print(line, file=sys.stderr, flush=True)
