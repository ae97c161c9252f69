"""Live progress of a run: a bar on a terminal, a line every few seconds anywhere else."""

import time
from collections.abc import Mapping

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

LINE_PERIOD = 5.0
"""Between two lines where there is no terminal, s."""


def summary(figures: Mapping[str, float]) -> str:
    """The main figures of a rollout, in words."""
    count = int(figures["episodes"])
    ended = (
        f"return {figures['return']:7.2f}  {round(figures['falls'] * count)} of {count} episodes fell"
        if count
        else "no episode ended"
    )
    errors = f"velocity error {figures['velocity_error']:.3f} m/s  yaw-rate error {figures['yaw_rate_error']:.3f} rad/s"
    validated = f"{figures['success']:.0%} succeeded in validation  " if "success" in figures else ""
    return f"{validated}{ended}  {errors}"


class Display:
    """Progress on standard output towards `total` steps, of which earlier sessions of the run have done `done`."""

    def __init__(self, total: int, done: int) -> None:
        columns = (
            BarColumn(bar_width=24),
            TextColumn("{task.completed:,.0f}/{task.total:,.0f} steps  {task.fields[rate]:,.0f}/s"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[summary]}"),
        )
        self._console = Console()
        self._bar = Progress(*columns, console=self._console, disable=not self._console.is_terminal)
        self._task = self._bar.add_task("train", total=total, completed=done, rate=0.0, summary="")
        self._total, self._done = total, done
        self._began, self._printed = time.monotonic(), float("-inf")
        self._bar.start()

    def update(self, steps: int, figures: Mapping[str, float]) -> None:
        """Show that `steps` have been taken, and the latest figures by name."""
        now = time.monotonic()
        rate = (steps - self._done) / max(now - self._began, 1e-9)
        self._bar.update(self._task, completed=steps, rate=rate, summary=summary(figures))
        if self._console.is_terminal or (now - self._printed < LINE_PERIOD and steps < self._total):
            return
        self._printed = now
        left = max(self._total - steps, 0) / max(rate, 1e-9)
        pace = f"{rate:6,.0f}/s  {left // 60:3.0f}:{left % 60:02.0f} left"
        self.note(f"{steps:>10,}/{self._total:,} steps  {pace}  {summary(figures)}")

    def note(self, text: str) -> None:
        """Print a line."""
        self._console.print(Text(text), soft_wrap=True)

    def close(self) -> None:
        """Remove the bar."""
        self._bar.stop()
