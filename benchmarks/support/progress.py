"""Progress on stderr: a bar on a terminal, a line a stage elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

Advance = Callable[[], None]


@contextmanager
def stage(description: str, total: int) -> Iterator[Advance]:
    """A callback that counts one of `total` parts of this stage as done."""
    console = Console(stderr=True)
    begin = time.perf_counter()
    if console.is_terminal:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with Progress(*columns, TextColumn("left"), TimeRemainingColumn(), console=console, transient=True) as progress:
            task = progress.add_task(description, total=total)
            yield lambda: progress.advance(task)
        return
    yield lambda: None
    print(f"{description}: {time.perf_counter() - begin:.1f} s", file=sys.stderr, flush=True)
