"""Real-time rate: makes a loop of control steps run at real time, or at a multiple of real time."""

import time
from collections.abc import Callable

MAX_LAG = 0.25
"""Largest delay that a loop catches up, wall time, s. The schedule restarts after a larger delay."""
MEASURED_TIME = 1.0
"""Duration over which the speed of the loop is measured, wall time, s."""


class RealTimeRate:
    """Timer that waits until the next step of a loop is due, and measures the speed of the loop.

    Args:
        period: Simulated time of a step, s.
        speed: Simulated time per wall time; the attribute may be changed while the loop runs.
        clock: Function that returns the wall time, s.
        sleep: Function that waits for a wall time, s.
    """

    def __init__(
        self,
        period: float,
        speed: float = 1.0,
        *,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.speed = speed
        self._clock = clock
        self._sleep = sleep
        self._period = period
        self.measured = 0.0
        """Simulated time per wall time, over the latest MEASURED_TIME; 0 before the first measurement."""
        self._due_time = self._measured_since = self._clock()
        self._step_count = 0

    def wait(self) -> None:
        """Sleep until the next step is due."""
        now = self._clock()
        if now - self._due_time > MAX_LAG:
            self._due_time = now
        self._sleep(max(0.0, self._due_time - now))
        self._due_time += self._period / self.speed
        self._step_count += 1
        if (elapsed := self._clock() - self._measured_since) >= MEASURED_TIME:
            self.measured = self._step_count * self._period / elapsed
            self._step_count = 0
            self._measured_since = self._clock()

    def resume(self) -> None:
        """Restart the schedule after a pause, so that the loop does not catch up the missed steps."""
        self._due_time = self._measured_since = self._clock()
        self._step_count = 0
