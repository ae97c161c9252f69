"""Samples of a sensor: noise from a stream per robot, sample rate and delay."""

import math

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, EnvIndices, Mask

Clock = NDArray[np.int64]
"""Control steps of some robots since the start of their episodes, (k,)."""
BLOCK = 50
"""Control steps. A robot's noise is drawn for so long at once; a larger block saves calls and takes more memory."""


class Noise:
    """White noise of n robots, from one random stream per robot.

    It is drawn in blocks of control steps: the noise of a step depends on the robot's stream and the step alone.

    Args:
        num_envs: Number of robots.
        std: Standard deviation of each entry, (width,).
    """

    def __init__(self, num_envs: int, std: NDArray[np.float32]) -> None:
        self._std = std
        self._noise = np.zeros((num_envs, BLOCK, len(std)), np.float32)
        self._block = np.full(num_envs, -1)
        """Number of the block that `_noise` holds, per robot."""
        self._streams: list[np.random.Generator | None] = [None] * num_envs

    def reset(self, env_index: int, stream: np.random.Generator) -> None:
        """Start an episode of robot `env_index`, with noise from `stream`."""
        self._block[env_index] = -1
        self._streams[env_index] = stream

    def at(self, clock: Clock, env_ids: EnvIndices) -> NDArray[np.float32]:
        """Return the noise of some robots at their control steps.

        Args:
            clock: Control steps since the start of the episode, (k,); they must not decrease from call to call.
            env_ids: Indices of the robots, (k,).

        Returns:
            Noise, (k, width).
        """
        block = clock // BLOCK
        for env_index in env_ids[self._block[env_ids] != block]:
            noise = self._noise[env_index]
            stream = self._streams[env_index]
            assert stream is not None
            stream.standard_normal(out=noise, dtype=np.float32)
            noise *= self._std
        self._block[env_ids] = block
        return self._noise[env_ids, clock % BLOCK]


class Channel:
    """Buffered samples of one sensor of n robots, with its sample rate and delay.

    Args:
        num_envs: Number of robots.
        width: Entries of a sample.
        rate: Sample rate, Hz; None for the control rate.
        delay: Time from taking a sample to seeing it, s.
        control_rate: Hz; an integer multiple of the sample rate.
        max_delay_steps: Oldest samples that are read, control steps; at least the delay is kept.

    Raises:
        ValueError: The control rate is no integer multiple of the sample rate.

    Attributes:
        period: Control steps between samples; sample s is taken at control step s * period.
        delay_steps: Control steps from taking a sample to seeing it.
    """

    def __init__(
        self, num_envs: int, width: int, rate: float | None, delay: float, control_rate: float, max_delay_steps: int = 0
    ) -> None:
        rate = control_rate if rate is None else rate
        self.period = round(control_rate / rate)
        if self.period < 1 or abs(self.period * rate - control_rate) > 1e-9:
            raise ValueError(
                f"a sensor's rate must be the control rate, {control_rate} Hz, or a whole part, got {rate}"
            )
        self.delay_steps = delay_to_steps(delay, control_rate)
        self._control_rate = control_rate
        # Sample s lies at index s modulo the length, which has room for two samples more: for differences.
        length = max(max_delay_steps, self.delay_steps) // self.period + 3
        self._samples = np.zeros((length, num_envs, width))

    def record(self, values: Array | NDArray[np.float32], clock: Clock, env_ids: EnvIndices) -> None:
        """Store the values where a sample is due; the first sample of an episode fills the buffer.

        Args:
            values: Present readings, (k, width).
            clock: Control steps since the start of the episode, (k,).
            env_ids: Indices of the robots, (k,).
        """
        is_due = clock % self.period == 0
        self._samples[clock[is_due] // self.period % len(self._samples), env_ids[is_due]] = values[is_due]
        is_first = clock == 0
        if is_first.any():
            self._samples[:, env_ids[is_first]] = values[is_first]

    def value(self, clock: Clock, env_ids: EnvIndices, delay_steps: int | None = None) -> Array:
        """Return the newest sample that is old enough to be seen; before that, the first sample.

        Args:
            clock: Control steps since the start of the episode, (k,).
            env_ids: Indices of the robots, (k,).
            delay_steps: Minimum age of the sample, control steps; by default the sensor's delay.

        Returns:
            Sample, (k, width).
        """
        return self._samples[self._sample_index(clock, delay_steps) % len(self._samples), env_ids]

    def previous(self, clock: Clock, env_ids: EnvIndices, delay_steps: int | None = None) -> Array:
        """Return the sample before the one of `value`; the first sample precedes itself.

        Args:
            clock: Control steps since the start of the episode, (k,).
            env_ids: Indices of the robots, (k,).
            delay_steps: Minimum age of the sample of `value`, control steps; by default the sensor's delay.

        Returns:
            Sample, (k, width).
        """
        return self.value(clock - self.period, env_ids, delay_steps)

    def is_new(self, clock: Clock, delay_steps: int) -> Mask:
        """Return True, (k,), where the sample at age `delay_steps` became visible in step `clock`."""
        is_new: Mask = np.logical_and(clock >= delay_steps, (clock - delay_steps) % self.period == 0)
        return is_new

    def time(self, clock: Clock) -> Array:
        """Return the time at which the sample of `value` was taken, (k,), s since the start of the episode."""
        return self._sample_index(clock, None) * self.period / self._control_rate

    @property
    def sample_period(self) -> float:
        """Time between two samples, s."""
        return self.period / self._control_rate

    def _sample_index(self, clock: Clock, delay_steps: int | None) -> NDArray[np.int64]:
        """Return the index of the newest visible sample of the episode, (k,)."""
        age = self.delay_steps if delay_steps is None else delay_steps
        return np.maximum((clock - age) // self.period, 0)


def delay_to_steps(delay: float, control_rate: float) -> int:
    """Return the control steps of a `delay`, s, at the `control_rate`, Hz, rounded up to the next step."""
    return math.ceil(delay * control_rate - 1e-9)
