"""Events of a recording: what happens to the robot and its commands, as lines of a log."""

from collections.abc import Iterator

import numpy as np

from live.outcome import NOTHING_YET, OutcomeSoFar
from live.recording.rows import Floats, Source
from quad_env.config import FALL_REASONS


class Events:
    """Finds events in rows that follow each other; a start after the first is a reset, and ends the episode before."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._outcome: OutcomeSoFar | None = None

    def before(self, readings: dict[str, Floats]) -> Iterator[str]:
        """What was so at the beginning of the row's step already."""
        if readings["start"][0]:
            yield from self.of_end()
        elif not np.array_equal(readings["command"], self._command):
            self._command = readings["command"]
            forward, left, turning = self._command
            yield f"command {forward:.2f} m/s forward, {left:.2f} m/s left, {turning:.2f} rad/s"

    def after(self, readings: dict[str, Floats]) -> Iterator[str]:
        """What happened in the row's step, and a reset."""
        if readings["start"][0]:
            if self._outcome is not None:
                yield "reset"
            self._outcome = OutcomeSoFar()
            self._outcome.begin(1, self._source.dt, self._source.command_steps)
            self._state, self._command = "over", np.full(3, np.nan)
            return
        assert self._outcome is not None  # the first row is a start
        fall, diverged = readings["fall"], readings["diverged"] > 0.0
        self._outcome.add(readings["command"][None], readings["heading_velocity"][None], fall > 0.0, diverged)
        state = "pushed" if readings["push"].any() else "over"
        if fall[0]:
            state = f"fell: {FALL_REASONS[int(fall[0])]}"
        if diverged[0]:
            state = "diverged"
        if state != self._state:
            self._state = state
            yield state

    def of_end(self) -> list[str]:
        """Outcome of the episode that ends now."""
        outcomes = [] if self._outcome is None else self._outcome.words()
        return [f"outcome: {name}" for name in outcomes if name != NOTHING_YET]
