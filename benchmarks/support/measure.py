"""Interleaved timing of functions.

The timed functions take turns (A B A B …), so that other work on the machine slows all of them equally. A round is one
call of each function.
"""

import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from evaluate.records.provenance import cpu_model

Floats = NDArray[np.float64]
TimedFunction = Callable[[], float]
"""Function that does the same work at every call, and returns the duration of one unit of the work, s."""
Advance = Callable[[], None]
"""Function that moves a progress bar forward by one part of the work."""


@contextmanager
def progress_bar(description: str, total: int) -> Iterator[Advance]:
    """Show the progress of `total` parts of work under a `description` on stderr.

    The progress is a bar if stderr is a terminal. Otherwise it is one line after the work, with the duration.

    Args:
        description: Name of the work.
        total: Number of parts.

    Yields:
        Function that moves the progress bar forward by one part.
    """
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


def interleave(
    timed_functions: Mapping[str, TimedFunction], rounds: int, title: str = "", warm_up: int = 1
) -> dict[str, Floats]:
    """Time functions that take turns.

    Args:
        timed_functions: Name -> function.
        rounds: Number of rounds; every function is called once in each round.
        title: Description of the progress bar; empty to show no bar.
        warm_up: Number of additional rounds before the timed ones.

    Returns:
        Name -> duration of one unit of work in each round, (rounds,), s.
    """
    seconds: dict[str, list[float]] = {name: [] for name in timed_functions}
    with progress_bar(title, warm_up + rounds) if title else nullcontext(lambda: None) as advance:
        for number in range(warm_up + rounds):
            for name, timed_function in timed_functions.items():
                duration = timed_function()
                if number >= warm_up:
                    seconds[name].append(duration)
            advance()
    return {name: np.array(values) for name, values in seconds.items()}


@dataclass(frozen=True)
class Quartiles:
    """Median and quartiles of a measured value over the rounds."""

    median: float
    """Median."""
    low: float
    """First quartile."""
    high: float
    """Third quartile."""

    def scaled(self, factor: float) -> "Quartiles":
        """Return median and quartiles multiplied by a positive `factor`, for a change of unit."""
        return Quartiles(self.median * factor, self.low * factor, self.high * factor)


def compute_quartiles(values: Floats) -> Quartiles:
    """Compute the median and the quartiles of the `values` in all rounds, (rounds,)."""
    low, median, high = np.quantile(values, (0.25, 0.5, 0.75))
    return Quartiles(float(median), float(low), float(high))


def speed_ratio(subject: Floats, other: Floats) -> Quartiles:
    """Return the speed of `subject` over the speed of `other`, from durations in each round, (rounds,)."""
    return compute_quartiles(other / subject)


def difference(subject: Floats, other: Floats) -> Quartiles:
    """Return the duration of `subject` minus `other`, from durations in each round, (rounds,), s."""
    return compute_quartiles(subject - other)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine_facts() -> dict[str, Any]:
    """Return facts about the machine by name: processor, cores, current load, software versions."""
    return {
        "cpu": cpu_model(),
        "cores": cores(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in ("mujoco", "numpy", "gymnasium")},
    }


def machine_line(facts: Mapping[str, Any]) -> str:
    """Format the facts of `machine_facts` as one line of text."""
    return (
        f"{facts['cpu']}, {facts['cores']} cores, load {facts['load']} at the start; Python {facts['python']}, "
        f"MuJoCo {facts['mujoco']}, NumPy {facts['numpy']}, Gymnasium {facts['gymnasium']}"
    )
