"""Real-time rate: makes a loop of control steps run at real time, or at a multiple of real time."""

import time

MAX_LAG = 0.25
"""Largest delay that a loop catches up, wall time, s. The schedule restarts after a larger delay."""
MEASURED_TIME = 1.0
"""Duration over which the speed of the loop is measured, wall time, s."""


class RealTimeRate:
    """Timer that waits until the next step of a loop is due, and measures the speed of the loop.

    Args:
        period: Simulated time of a step, s.
        speed: Simulated time per wall time; the attribute may be changed while the loop runs.
    """

    def __init__(self, period: float, speed: float = 1.0) -> None:
        self.speed = speed
        self._period = period
        self.measured = 0.0
        """Simulated time per wall time, over the latest MEASURED_TIME; 0 before the first measurement."""
        self._due_time = self._measured_since = time.perf_counter()
        self._step_count = 0

    def wait(self) -> None:
        """Sleep until the next step is due."""
        now = time.perf_counter()
        if now - self._due_time > MAX_LAG:
            self._due_time = now
        time.sleep(max(0.0, self._due_time - now))
        self._due_time += self._period / self.speed
        self._step_count += 1
        if (elapsed := time.perf_counter() - self._measured_since) >= MEASURED_TIME:
            self.measured = self._step_count * self._period / elapsed
            self._step_count = 0
            self._measured_since = time.perf_counter()

    def resume(self) -> None:
        """Restart the schedule after a pause, so that the loop does not catch up the missed steps."""
        self._due_time = self._measured_since = time.perf_counter()
        self._step_count = 0
