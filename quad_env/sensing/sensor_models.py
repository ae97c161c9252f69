"""Sensor models of n robots: true values in, biased, noisy, sampled and delayed readings out."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, EnvIndices, Mask
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.scenarios.episode import EpisodeSample
from quad_env.sensing.suite import SensorSuite

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


class SensorModels:
    """Sensor models of n robots: bias, noise, range, resolution, rate and delay.

    A reading is the true value + bias + noise, then clipped to the range or rounded to a step of an encoder. A foot is
    in contact where its reading is at least its threshold.

    Args:
        robot: The robots' joints, legs and rated torque.
        suite: Their sensors.
        num_envs: Number of robots.
        control_rate: Hz.

    Attributes:
        bias: Biases of each robot's present episode, (n, 34), in the order of the channels.
        channels: Sensor name -> its samples.
        alignment_delay: Age, in control steps, at which all sensors of motion and contact have reported.
    """

    def __init__(self, robot: Robot, suite: SensorSuite, num_envs: int, control_rate: float) -> None:
        joints = robot.num_joints
        legs = len(robot.leg_names)
        self._widths = {
            "gyro": 3,
            "accelerometer": 3,
            "joint_position": joints,
            "foot_contact": legs,
            "joint_torque": joints,
        }
        imu = suite.imu
        encoders = suite.encoders
        feet = suite.feet
        torque = suite.torque
        self._encoder_step = encoders.step
        self._contact_threshold = feet.threshold
        self._bias_std = self._repeat(imu.gyro_bias, imu.accelerometer_bias, encoders.zero_offset, 0.0, torque.bias)
        torque_range = robot.rated_torque if torque.range is None else torque.range
        self._range = self._repeat(imu.gyro_range, imu.accelerometer_range, np.inf, np.inf, torque_range)
        noise_std = self._repeat(imu.gyro_noise, imu.accelerometer_noise, encoders.noise, feet.noise, torque.noise)
        self._noise = Noise(num_envs, noise_std.astype(np.float32))
        self.bias = np.zeros((num_envs, len(noise_std)))
        self.alignment_delay = max(delay_to_steps(sensor.delay, control_rate) for sensor in (imu, encoders, feet))
        sensors = dict(zip(self._widths, (imu, imu, encoders, feet, torque), strict=True))
        self.channels = {
            name: Channel(num_envs, self._widths[name], sensor.rate, sensor.delay, control_rate, self.alignment_delay)
            for name, sensor in sensors.items()
        }

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Draw the biases of some robots and restart their noise.

        Args:
            env_ids: Indices of the robots, (k,).
            episodes: Their new episodes, k.
        """
        start = self._widths["gyro"] + self._widths["accelerometer"]
        encoders = slice(start, start + self._widths["joint_position"])
        for env_index, episode in zip(env_ids, episodes, strict=True):
            stream = episode.streams.sensors
            self.bias[env_index] = self._bias_std * stream.standard_normal(len(self._bias_std))
            if episode.randomised is not None:
                self.bias[env_index, encoders] += episode.randomised.encoder_offset
            self._noise.reset(env_index, stream)

    def read(self, true_values: Mapping[str, Array], clock: Clock, env_ids: EnvIndices) -> None:
        """Record the readings of the sensors where a sample is due.

        Args:
            true_values: Sensor name -> noise-free value, (k, width).
            clock: Control steps since the start of the episode, (k,).
            env_ids: Indices of the robots, (k,).
        """
        readings = np.concatenate([true_values[name] for name in self._widths], axis=1)
        readings += self.bias[env_ids] + self._noise.at(clock, env_ids)
        np.clip(readings, -self._range, self._range, out=readings)
        start = 0
        for name, width in self._widths.items():
            sample = self._quantize(name, readings[:, start : start + width])
            self.channels[name].record(sample, clock, env_ids)
            start += width

    def specific_force_at_rest(self, up: Array, env_ids: EnvIndices) -> Array:
        """Return the mean accelerometer readings of robots at rest.

        Args:
            up: World vertical in the axes of the IMU, (k, 3).
            env_ids: Indices of the robots, (k,).

        Returns:
            Specific force with the bias, without noise, (k, 3), m/s².
        """
        start = self._widths["gyro"]
        return GRAVITY * up + self.bias[env_ids, start : start + self._widths["accelerometer"]]

    def _quantize(self, name: str, readings: Array) -> Array:
        """Return contacts as 0 or 1 and joint angles in steps of the encoder."""
        if name == "foot_contact":
            return (readings >= self._contact_threshold).astype(np.float64)
        if name == "joint_position" and self._encoder_step:
            return self._encoder_step * np.rint(readings / self._encoder_step)
        return readings

    def _repeat(self, *value_by_sensor: float) -> Array:
        """Repeat a value per sensor for each of its entries, (34,)."""
        return np.repeat(np.array(value_by_sensor), list(self._widths.values()))
