"""A sensor's samples, their noise, and their way to the reader: taken at a rate, seen late."""

import math

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, EnvIndices

Clock = NDArray[np.int64]
"""Control steps of some robots since the start of their episodes, (k,)."""
BLOCK = 50
"""Control steps for which a robot's noise is drawn at once."""


class Noise:
    """White noise of n robots, each from its own stream; `deviation`, (k,), is the standard deviation of each entry.

    Drawn a block of steps at a time: that of a step depends on the robot's stream and the step alone.
    """

    def __init__(self, num_envs: int, deviation: NDArray[np.float32]) -> None:
        self._deviation = deviation
        self._noise = np.zeros((num_envs, BLOCK, len(deviation)), np.float32)
        self._block = np.full(num_envs, -1)
        """Which block of steps each robot's noise is of."""
        self._streams: list[np.random.Generator | None] = [None] * num_envs

    def reset(self, row: int, stream: np.random.Generator) -> None:
        """That robot starts an episode, whose stream this is."""
        self._block[row], self._streams[row] = -1, stream

    def at(self, clock: NDArray[np.int64], rows: EnvIndices) -> NDArray[np.float32]:
        """Noise of those robots at these control steps since their start, which only go up, (n, k)."""
        block = clock // BLOCK
        for row in rows[self._block[rows] != block]:
            noise, stream = self._noise[row], self._streams[row]
            assert stream is not None
            stream.standard_normal(out=noise, dtype=np.float32)
            noise *= self._deviation
        self._block[rows] = block
        return self._noise[rows, clock % BLOCK]


class Channel:
    """Samples of one sensor of n robots; sample s is that of control step s times `period`.

    Args:
        num_envs, width: of the samples, (num_envs, width).
        rate: samples a second; None for one a control step.
        delay: s from taking a sample to seeing it.
        control_rate: Hz, a whole multiple of the rate.
        oldest: control steps back in time to which the samples are asked for; at least the delay.
    """

    def __init__(
        self, num_envs: int, width: int, rate: float | None, delay: float, control_rate: float, max_delay_steps: int = 0
    ) -> None:
        rate = control_rate if rate is None else rate
        self.period = round(control_rate / rate)
        """Control steps from sample to sample."""
        if self.period < 1 or abs(self.period * rate - control_rate) > 1e-9:
            raise ValueError(
                f"a sensor's rate must be the control rate, {control_rate} Hz, or a whole part, got {rate}"
            )
        self.late = delay_to_steps(delay, control_rate)
        """Control steps from taking a sample to seeing it."""
        self._control_rate = control_rate
        self._samples = np.zeros((max(max_delay_steps, self.late) // self.period + 3, num_envs, width))
        """Sample s is at s modulo its length; two more than are seen late, for differences."""

    def record(self, values: Array | NDArray[np.float32], clock: Clock, rows: EnvIndices) -> None:
        """Samples of those robots' sensors, which would now read these values, (k, width); kept where one is due."""
        due = clock % self.period == 0
        self._samples[clock[due] // self.period % len(self._samples), rows[due]] = values[due]
        first = clock == 0
        if first.any():
            self._samples[:, rows[first]] = values[first]

    def value(self, clock: Clock, rows: EnvIndices, delay_steps: int | None = None) -> Array:
        """The newest sample that is at least `late` control steps old, by default those of the delay, (k, width).

        Until there is one, the first.
        """
        return self._samples[self._number(clock, delay_steps) % len(self._samples), rows]

    def previous(self, clock: Clock, rows: EnvIndices, delay_steps: int | None = None) -> Array:
        """The sample before that of `value`, (k, width); the first has itself before it."""
        return self.value(clock - self.period, rows, delay_steps)

    def is_new(self, clock: Clock, delay_steps: int) -> NDArray[np.bool_]:
        """Whose sample of `value` was not there one control step earlier, (k,)."""
        is_new: NDArray[np.bool_] = np.logical_and(clock >= delay_steps, (clock - delay_steps) % self.period == 0)
        return is_new

    def time(self, clock: Clock) -> Array:
        """When the sample of `value` was taken, s since the start of the episode, (k,)."""
        return self._number(clock, None) * self.period / self._control_rate

    @property
    def sample_period(self) -> float:
        """s from sample to sample."""
        return self.period / self._control_rate

    def _number(self, clock: Clock, delay_steps: int | None) -> NDArray[np.int64]:
        return np.maximum((clock - (self.late if delay_steps is None else delay_steps)) // self.period, 0)


def delay_to_steps(delay: float, control_rate: float) -> int:
    """Control steps that a delay, s, takes: what arrives between two of them is seen at the next."""
    return math.ceil(delay * control_rate - 1e-9)
