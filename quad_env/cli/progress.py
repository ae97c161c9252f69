"""Live progress on stderr with the time left: a bar on a terminal, one line a finished cell elsewhere."""

import contextlib
import itertools
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeAlias

from quad_env.cli.interrupt import Interrupt

CellProgress: TypeAlias = Callable[[str, str, float], None]
"""Takes the policy and the scenario of a cell, and the share of it that is done, 0 to 1."""


class Forecast:
    """How long the rest takes: a cell as long as the finished ones of its policy did, for one that falls is soon done.

    Every cell has the same episodes of the same steps; what an earlier run had done already took no time.
    """

    def __init__(self, policies: Sequence[str], now: float) -> None:
        """`policies` has the policy of each cell."""
        self._left = {policy: float(count) for policy, count in Counter(policies).items()}
        self._seconds: dict[str, float] = defaultdict(float)
        self._cells: dict[str, float] = defaultdict(float)
        self._shares: dict[tuple[str, str], float] = {}
        self._since = now

    def update(self, policy: str, scenario: str, share: float, now: float) -> None:
        """Take note that so much of a cell is done; several cells may be under way."""
        # What is done at a cell's first report was kept by an earlier run.
        advance = share - self._shares.get((policy, scenario), share)
        self._left[policy] -= share - self._shares.get((policy, scenario), 0.0)
        self._shares[policy, scenario] = share
        self._cells[policy] += advance
        self._seconds[policy] += now - self._since
        self._since = now

    @property
    def seconds(self) -> float | None:
        """Time left, s; None before anything is known."""
        done = sum(self._cells.values())
        if done <= 0.0:
            return None
        usual = sum(self._seconds.values()) / done
        paces = {p: self._seconds[p] / self._cells[p] if self._cells[p] > 0.0 else usual for p in self._left}
        return sum(max(cells, 0.0) * paces[policy] for policy, cells in self._left.items())


@contextmanager
def show_progress(policies: Sequence[str]) -> Iterator[CellProgress]:
    """A callback that shows how far a comparison is whose cells are of these policies, and how long the rest takes."""
    from rich.console import Console

    console = Console(stderr=True)
    forecast, total = Forecast(policies, time.perf_counter()), len(policies)
    if not console.is_terminal:
        yield _lines(total, forecast)
        return
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, TextColumn("{task.fields[left]}"), console=console, transient=True) as progress:
        task = progress.add_task("starting", total=total, left="")
        shares: dict[tuple[str, str], float] = {}

        def show(policy: str, scenario: str, share: float) -> None:
            shares[policy, scenario] = share
            forecast.update(policy, scenario, share, time.perf_counter())
            left = "" if forecast.seconds is None else f"{duration(forecast.seconds)} left"
            progress.update(task, description=f"{scenario}: {policy}", completed=sum(shares.values()), left=left)

        yield show


def duration(seconds: float) -> str:
    """`8 s`, `3 min 20 s`, `2 h 5 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _lines(total: int, forecast: Forecast) -> CellProgress:
    """One line a finished cell, for logs."""
    start, finished = time.perf_counter(), itertools.count(1)

    def show(policy: str, scenario: str, share: float) -> None:
        now = time.perf_counter()
        forecast.update(policy, scenario, share, now)
        if share < 1.0:
            return
        number, seconds = next(finished), forecast.seconds
        left = "" if seconds is None or number == total else f", about {duration(seconds)} left"
        with contextlib.suppress(OSError):  # a log that cannot be written is no reason to lose the run
            line = f"[{number}/{total}] {scenario}: {policy} ({duration(now - start)}{left})"
            print(line, file=sys.stderr, flush=True)

    return show


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
