"""Live progress of a run: a bar on a terminal, a line every few seconds anywhere else."""

import time
from collections.abc import Mapping

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.text import Text

from train.sb3.pace import Pace

LINE_PERIOD = 5.0
"""Between two lines where there is no terminal, s."""


def summary(figures: Mapping[str, float]) -> str:
    """The main figures of a rollout, in words."""
    ended, count = "no episode ended", int(figures["episodes"])
    if count:
        ended = f"return {figures['return']:7.2f}  {round(figures['falls'] * count)} of {count} episodes fell"
    errors = f"velocity error {figures['velocity_error']:.3f} m/s  yaw-rate error {figures['yaw_rate_error']:.3f} rad/s"
    validated = f"{figures['success']:.0%} succeeded in validation  " if "success" in figures else ""
    return f"{validated}{ended}  {errors}"


class Display:
    """Progress on standard output towards `total` steps, with the time left by `pace`."""

    def __init__(self, total: int, pace: Pace) -> None:
        self.pace = pace
        self._console = Console()
        columns = BarColumn(bar_width=24), TextColumn("{task.description}", markup=False)
        self._bar = Progress(*columns, console=self._console, disable=not self._console.is_terminal)
        self._task = self._bar.add_task("", total=total)
        self._total, self._printed = total, float("-inf")
        self._bar.start()

    def update(self, steps: int, figures: Mapping[str, float]) -> None:
        """Show that `steps` have been taken, and the latest figures by name."""
        minutes, seconds = divmod(round(self.pace.left(steps)), 60)
        pace = f"{self.pace.rate(steps):6,.0f}/s  {minutes:3}:{seconds:02} left"
        line = f"{steps:>10,}/{self._total:,} steps  {pace}  {summary(figures)}"
        self._bar.update(self._task, completed=steps, description=line)
        now = time.monotonic()
        if not self._console.is_terminal and (now - self._printed >= LINE_PERIOD or steps >= self._total):
            self._printed = now
            self.note(line)

    def note(self, text: str) -> None:
        """Print a line."""
        self._console.print(Text(text), soft_wrap=True)

    def close(self) -> None:
        """Remove the bar."""
        self._bar.stop()
