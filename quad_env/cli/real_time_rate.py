"""Real-time rate: holds a loop of control steps to real time, or to a multiple of it."""

import time

MAX_LAG = 0.25
"""s. Wall time that a loop may be late; a later loop does not catch up."""
MEASURED_TIME = 1.0
"""s. Wall time over which the speed of the loop is measured."""


class RealTimeRate:
    """Waits until the next step is due, and measures the speed of the loop.

    Args:
        period: Simulated time of a step, s.
        speed: Simulated s per wall s; may be changed under way.
    """

    def __init__(self, period: float, speed: float = 1.0) -> None:
        self.speed = speed
        self._period = period
        self.measured = 0.0
        """Simulated s per wall s over the latest MEASURED_TIME; 0 before that."""
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
        """Go on after a pause without catching up the missed steps."""
        self._due_time = self._measured_since = time.perf_counter()
        self._step_count = 0
