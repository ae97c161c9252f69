"""Times functions that take turns, and computes statistics of the measured durations.

The functions are called in turns (A B A B …), so that other work on the machine slows all functions equally. In a
round, each function is called once.
"""

import os
import platform
import sys
import time
from collections import defaultdict
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
"""Type of a function that does the same work at every call, and returns the duration of the work, s."""
Clock = Callable[[], float]
"""Type of a function that returns the present time, s."""
Advance = Callable[[], None]
"""Type of a function that moves a progress bar forward; it is called when one part of the work is done."""


class Stopwatch:
    """Stopwatch that measures the total duration of all calls of functions, which its method `timed` wraps.

    Args:
        clock: Function that returns the present time, s; by default wall time.
    """

    def __init__(self, clock: Clock = time.perf_counter) -> None:
        self._clock = clock
        self.seconds = defaultdict[str, float](float)
        """Name of a wrapped function, as given to `timed` -> total duration of all calls of the function, s."""

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that calls `function` and adds the duration of the call to `seconds[name]`."""

        def call(*args: Any, **kwargs: Any) -> Any:
            begin = self._clock()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds[name] += self._clock() - begin

        return call


@contextmanager
def progress_bar(description: str, total: int) -> Iterator[Advance]:
    """Show the progress of some work on stderr, as a context manager.

    A progress bar is shown if stderr is a terminal. Otherwise one line with the duration is printed after the work.

    Args:
        description: Name of the work, shown in front of the bar.
        total: Number of parts of the work.

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
    """Time several functions that take turns, so that other work on the machine slows all of them equally.

    Args:
        timed_functions: Name -> function that does the same work at every call and returns the duration, s.
        rounds: Number of rounds; every function is called once in each round.
        title: Description of the progress bar; empty to show no bar.
        warm_up: Number of rounds before the first timed round, in which the durations are ignored.

    Returns:
        Name -> duration that the function returned in each timed round, (rounds,), s.
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
    """Median and quartiles of a measured value over the measurement rounds."""

    median: float
    """Median over the rounds, in the unit of the measured value."""
    low: float
    """First quartile over the rounds, in the unit of the measured value."""
    high: float
    """Third quartile over the rounds, in the unit of the measured value."""

    def scaled(self, factor: float) -> "Quartiles":
        """Return median and quartiles multiplied by a positive `factor`, for example to convert s to µs."""
        return Quartiles(self.median * factor, self.low * factor, self.high * factor)


def compute_quartiles(values: Floats) -> Quartiles:
    """Compute the median and the quartiles of the values that were measured in all rounds, (rounds,)."""
    low, median, high = np.quantile(values, (0.25, 0.5, 0.75))
    return Quartiles(float(median), float(low), float(high))


def speed_ratio(subject: Floats, other: Floats) -> Quartiles:
    """Compute the ratio of the speeds of two functions over the measurement rounds.

    Args:
        subject: Duration of the first function in each round, (rounds,), s.
        other: Duration of the second function in each round, (rounds,), s.

    Returns:
        Median and quartiles of the ratio; it is larger than 1 if the first function is faster.
    """
    return compute_quartiles(other / subject)


def difference(subject: Floats, other: Floats) -> Quartiles:
    """Compute the difference of the durations of two functions over the measurement rounds.

    Args:
        subject: Duration of the first function in each round, (rounds,), s.
        other: Duration of the second function in each round, (rounds,), s.

    Returns:
        Median and quartiles of `subject` minus `other`, s.
    """
    return compute_quartiles(subject - other)


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine_facts() -> dict[str, Any]:
    """Return facts about this machine and its Python packages, for the report of a benchmark.

    Returns:
        Dictionary: `cpu`, name of the processor; `cores`, number of cores; `load`, mean load of the last minute, None
        if the system does not report it; `python`, `mujoco`, `numpy` and `gymnasium`, versions.
    """
    return {
        "cpu": cpu_model(),
        "cores": cores(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in ("mujoco", "numpy", "gymnasium")},
    }


def machine_line(facts: Mapping[str, Any]) -> str:
    """Format facts about the machine, from `machine_facts`, as one line of text."""
    return (
        f"{facts['cpu']}, {facts['cores']} cores, load {facts['load']} at the start; Python {facts['python']}, "
        f"MuJoCo {facts['mujoco']}, NumPy {facts['numpy']}, Gymnasium {facts['gymnasium']}"
    )
