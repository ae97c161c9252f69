"""Live progress of a run: a line every few seconds."""

import time
from collections.abc import Mapping

LINE_PERIOD = 5.0
"""Between two lines, s."""


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
        self._total, self._done = total, done
        self._began, self._printed = time.monotonic(), float("-inf")

    def update(self, steps: int, figures: Mapping[str, float]) -> None:
        """Show that `steps` have been taken, and the latest figures by name."""
        now = time.monotonic()
        if now - self._printed < LINE_PERIOD and steps < self._total:
            return
        self._printed = now
        rate = (steps - self._done) / max(now - self._began, 1e-9)
        left = max(self._total - steps, 0) / max(rate, 1e-9)
        pace = f"{rate:6,.0f}/s  {left // 60:3.0f}:{left % 60:02.0f} left"
        note(f"{steps:>10,}/{self._total:,} steps  {pace}  {summary(figures)}")


def note(text: str) -> None:
    """Print a line."""
    print(text, flush=True)
