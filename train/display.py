"""Live progress of a run: a bar on a terminal, a line every few seconds anywhere else."""

import time
from collections.abc import Mapping
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

LINE_PERIOD = 5.0
"""Between two lines where there is no terminal, s."""


class Display(Protocol):
    """Where progress is shown."""

    def update(self, steps: int, figures: Mapping[str, float]) -> None:
        """Show that `steps` have been taken, and the latest figures by name."""

    def note(self, text: str) -> None:
        """Show a line that stays."""

    def close(self) -> None:
        """Leave the terminal as it was."""


def make_display(total: int, done: int) -> Display:
    """The display that suits standard output; `done` steps were taken by an earlier session of the same run."""
    console = Console()
    return BarDisplay(console, total, done) if console.is_terminal else LineDisplay(total, done)


def summary(figures: Mapping[str, float]) -> str:
    """The figures of a rollout that a trainer looks at."""
    count = int(figures["episodes"])
    ended = (
        f"return {figures['return']:7.2f}  {round(figures['falls'] * count)} of {count} episodes fell"
        if count
        else "no episode ended"
    )
    errors = f"velocity error {figures['velocity_error']:.3f} m/s  yaw-rate error {figures['yaw_rate_error']:.3f} rad/s"
    return f"{ended}  {errors}"


class BarDisplay:
    """A bar that is redrawn in place."""

    def __init__(self, console: Console, total: int, done: int) -> None:
        columns = (
            BarColumn(bar_width=24),
            TextColumn("{task.completed:,.0f}/{task.total:,.0f} steps  {task.fields[rate]:,.0f}/s"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[summary]}"),
        )
        self._progress = Progress(*columns, console=console)
        self._task = self._progress.add_task("train", total=total, completed=done, rate=0.0, summary="")
        self._rate = Rate(done)
        self._progress.start()

    def update(self, steps: int, figures: Mapping[str, float]) -> None:
        """Redraw the bar."""
        rate = self._rate(steps)
        self._progress.update(self._task, completed=steps, rate=rate, summary=summary(figures))

    def note(self, text: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(text, highlight=False)

    def close(self) -> None:
        """Stop redrawing."""
        self._progress.stop()


class LineDisplay:
    """A line at most every five seconds."""

    def __init__(self, total: int, done: int) -> None:
        self._total = total
        self._rate = Rate(done)
        self._printed = float("-inf")

    def update(self, steps: int, figures: Mapping[str, float]) -> None:
        """Print a line, unless the last is recent."""
        rate = self._rate(steps)
        if time.monotonic() - self._printed < LINE_PERIOD and steps < self._total:
            return
        self._printed = time.monotonic()
        left = max(self._total - steps, 0) / max(rate, 1e-9)
        pace = f"{rate:6,.0f}/s  {left // 60:3.0f}:{left % 60:02.0f} left"
        print(f"{steps:>10,}/{self._total:,} steps  {pace}  {summary(figures)}", flush=True)

    def note(self, text: str) -> None:
        """Print a line."""
        print(text, flush=True)

    def close(self) -> None:
        """Nothing to put back."""


class Rate:
    """Steps a second since it was made."""

    def __init__(self, done: int) -> None:
        self._done = done
        self._start = time.monotonic()

    def __call__(self, steps: int) -> float:
        """Mean rate up to now, when `steps` have been taken in all."""
        return (steps - self._done) / max(time.monotonic() - self._start, 1e-9)
