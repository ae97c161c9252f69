"""Pace: holds a loop of control steps back to real time, or to a share of it."""

import time

LAG = 0.25
"""Wall time by which a loop may be behind before it gives up catching up, s."""


class RealTimeRate:
    """Says when the next step is due, and how fast the loop really is.

    Args:
        period: simulated time of a step, s.
        speed: simulated s a wall s; may be changed under way.
    """

    def __init__(self, period: float, speed: float = 1.0) -> None:
        self.speed = speed
        self._period = period
        self._due = self._since = time.perf_counter()
        self._steps = 0
        self.measured = 0.0
        """Simulated s a wall s over the latest second, 0 before it."""

    def wait(self) -> None:
        """Sleep until the next step is due."""
        now = time.perf_counter()
        if now - self._due > LAG:
            self._due = now
        time.sleep(max(0.0, self._due - now))
        self._due += self._period / self.speed
        self._steps += 1
        if (passed := time.perf_counter() - self._since) >= 1.0:
            self.measured = self._steps * self._period / passed
            self._steps, self._since = 0, time.perf_counter()

    def resume(self) -> None:
        """Go on after a pause, without catching up what was not stepped in it."""
        self._due = self._since = time.perf_counter()
        self._steps = 0
