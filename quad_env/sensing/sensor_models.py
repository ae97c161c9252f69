"""Sensor models of n robots: convert true values to biased, noisy, sampled and delayed readings."""

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
"""Control steps since the start of the episode of each robot, (k,)."""
BLOCK = 50
"""Number of control steps for which noise is drawn at once.

A larger block needs fewer calls of the random generator and more memory.
"""


class Noise:
    """White noise of n robots, from one random stream per robot.

    Noise is drawn in blocks of `BLOCK` control steps. The noise of a robot depends only on its stream and on the
    control step.

    Args:
        num_envs: Number of robots.
        std: Standard deviation of each entry, (width,).
    """

    def __init__(self, num_envs: int, std: NDArray[np.float32]) -> None:
        self._std = std
        self._noise = np.zeros((num_envs, BLOCK, len(std)), np.float32)
        self._block = np.full(num_envs, -1)
        """Index of the block that `_noise` holds for each robot, (n,); -1 before the first."""
        self._streams: list[np.random.Generator | None] = [None] * num_envs

    def reset(self, env_index: int, stream: np.random.Generator) -> None:
        """Start an episode of the robot `env_index`; its noise is drawn from `stream`."""
        self._block[env_index] = -1
        self._streams[env_index] = stream

    def at(self, clock: Clock, env_ids: EnvIndices) -> NDArray[np.float32]:
        """Return the noise of some robots at their control steps.

        Args:
            clock: Control steps since the start of the episode, (k,); must not decrease from call to call.
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
        width: Number of entries of a sample.
        rate: Sample rate, Hz; None for the control rate.
        delay: Time after which a sample becomes visible, s.
        control_rate: Control rate, an integer multiple of the sample rate, Hz.
        max_delay_steps: Largest `delay_steps` that `value` will be called with, control steps. The buffer is always
            long enough for `delay`.

    Raises:
        ValueError: The control rate is no integer multiple of the sample rate.

    Attributes:
        period: Number of control steps between two samples; sample s is taken at control step s * period.
        delay_steps: Number of control steps after which a sample becomes visible.
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
        # Sample s is stored at index s modulo the length. The length has room for older samples, because `previous`
        # reads the sample before the visible one.
        length = max(max_delay_steps, self.delay_steps) // self.period + 3
        self._samples = np.zeros((length, num_envs, width))

    def record(self, values: Array | NDArray[np.float32], clock: Clock, env_ids: EnvIndices) -> None:
        """Store the readings of robots with a sample due; the first sample of an episode fills the buffer.

        Args:
            values: Present readings of k robots, (k, width).
            clock: Control steps since the start of the episode, (k,).
            env_ids: Indices of the robots, (k,).
        """
        is_due = clock % self.period == 0
        self._samples[clock[is_due] // self.period % len(self._samples), env_ids[is_due]] = values[is_due]
        is_first = clock == 0
        if is_first.any():
            self._samples[:, env_ids[is_first]] = values[is_first]

    def value(self, clock: Clock, env_ids: EnvIndices, delay_steps: int | None = None) -> Array:
        """Return the newest visible sample; the first sample of the episode while no sample is visible yet.

        Args:
            clock: Control steps since the start of the episode, (k,).
            env_ids: Indices of the robots, (k,).
            delay_steps: Age from which a sample is visible, control steps; None for the sensor's delay.

        Returns:
            Sample, (k, width).
        """
        return self._samples[self._sample_index(clock, delay_steps) % len(self._samples), env_ids]

    def previous(self, clock: Clock, env_ids: EnvIndices, delay_steps: int | None = None) -> Array:
        """Return the sample before the result of `value`; the first sample if there is none before.

        Args:
            clock: Control steps since the start of the episode, (k,).
            env_ids: Indices of the robots, (k,).
            delay_steps: Age from which a sample is visible, control steps; None for the sensor's delay.

        Returns:
            Sample, (k, width).
        """
        return self.value(clock - self.period, env_ids, delay_steps)

    def is_new(self, clock: Clock, delay_steps: int) -> Mask:
        """Return a mask of the robots with a sample that reaches the age `delay_steps` in step `clock`, (k,)."""
        is_new: Mask = np.logical_and(clock >= delay_steps, (clock - delay_steps) % self.period == 0)
        return is_new

    def time(self, clock: Clock) -> Array:
        """Return the time since the start of the episode at which the visible sample was taken, (k,), s."""
        return self._sample_index(clock, None) * self.period / self._control_rate

    @property
    def sample_period(self) -> float:
        """Time between two samples, s."""
        return self.period / self._control_rate

    def _sample_index(self, clock: Clock, delay_steps: int | None) -> NDArray[np.int64]:
        """Return the number of the newest visible sample, counted from 0 at the start of the episode, (k,)."""
        age = self.delay_steps if delay_steps is None else delay_steps
        return np.maximum((clock - age) // self.period, 0)


def delay_to_steps(delay: float, control_rate: float) -> int:
    """Convert a `delay`, s, to control steps at the `control_rate`, Hz, rounded up."""
    return math.ceil(delay * control_rate - 1e-9)


class SensorModels:
    """Sensor models of n robots: bias, noise, range, resolution, rate and delay.

    A reading is the true value + bias + noise. Readings are clipped to the range, and joint angles are rounded to a
    step of the encoder. A foot sensor reads contact if its force is at least the threshold.

    Args:
        robot: Robot with its joints, legs and rated torque.
        suite: Sensors of the robots.
        num_envs: Number of robots.
        control_rate: Control rate, Hz.

    Attributes:
        bias: Bias of every sensor entry in the present episode of each robot, in the order of `channels`, (n, 34).
        channels: Sensor name -> buffer of the sensor's samples.
        alignment_delay: Age from which samples of the IMU, the encoders and the foot sensors are all visible, control
            steps.
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
            episodes: New episodes of the k robots.
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
        """Record a reading of each sensor that has a sample due in this control step.

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
        """Return the mean accelerometer readings of robots that stand still.

        Args:
            up: World vertical, IMU axes, (k, 3).
            env_ids: Indices of the robots, (k,).

        Returns:
            Specific force with bias and without noise, IMU axes, (k, 3), m/s².
        """
        start = self._widths["gyro"]
        return GRAVITY * up + self.bias[env_ids, start : start + self._widths["accelerometer"]]

    def _quantize(self, name: str, readings: Array) -> Array:
        """Convert foot forces to contact, 0 or 1, and joint angles to encoder steps; keep other readings."""
        if name == "foot_contact":
            return (readings >= self._contact_threshold).astype(np.float64)
        if name == "joint_position" and self._encoder_step:
            return self._encoder_step * np.rint(readings / self._encoder_step)
        return readings

    def _repeat(self, *value_by_sensor: float) -> Array:
        """Return an array with the value of each sensor repeated for all entries of that sensor, (34,)."""
        return np.repeat(np.array(value_by_sensor), list(self._widths.values()))
