"""Timer that makes a simulation loop run in real time, or at a multiple of real time."""

import time
from collections.abc import Callable

MAX_LAG = 0.25
"""Largest delay that a simulation loop catches up by faster steps, wall time, s.

After a larger delay, the next step is due immediately, and the loop skips the missed time.
"""
MEASURED_TIME = 1.0
"""Wall time over which the speed of a simulation loop is averaged, s."""


class RealTimeRate:
    """Timer of a simulation loop: waits until the next step is due, and measures the speed of the loop.

    Args:
        period: Simulated time per step of the loop, s.
        speed: Desired simulated time per wall time, 1 for real time; the attribute may be changed while the loop runs.
        clock: Function without arguments that returns the wall time, s.
        sleep: Function that takes a duration, s, and waits for it.
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
        """Measured speed of the loop: simulated time per wall time; 0 before the first measurement."""
        self.lag = 0.0
        """Time from the moment at which the latest step was due to its start, wall time, s."""
        self._due_time = self._measured_since = self._clock()
        self._step_count = 0

    def wait(self) -> None:
        """Sleep until the next step of the loop is due; the loop calls this method once per step."""
        now = self._clock()
        due_time = self._due_time
        if now - self._due_time > MAX_LAG:
            self._due_time = now
        self._sleep(max(0.0, self._due_time - now))
        self.lag = self._clock() - due_time
        self._due_time += self._period / self.speed
        self._step_count += 1
        if (elapsed := self._clock() - self._measured_since) >= MEASURED_TIME:
            self.measured = self._step_count * self._period / elapsed
            self._step_count = 0
            self._measured_since = self._clock()

    def resume(self) -> None:
        """Make the next step due immediately, so that the loop does not execute the steps that it missed in a pause."""
        self._due_time = self._measured_since = self._clock()
        self._step_count = 0
