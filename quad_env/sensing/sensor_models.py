"""Sensor models of n robots: they convert true values to biased, noisy, sampled and delayed readings."""

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
"""Array type: number of control steps since the start of the episode, for each of k robots, (k,)."""
BLOCK = 50
"""Number of control steps for which `Noise` draws random numbers at once.

With a larger number, `Noise` needs fewer calls of the random generator and more memory.
"""


class Noise:
    """White noise of the sensor readings or observations of n robots, from one random stream per robot.

    Noise is drawn in blocks of `BLOCK` control steps. The noise of a robot depends only on its stream and on the
    control step.

    Args:
        num_envs: Number of robots.
        std: Standard deviation of each component of a sample, (width,); `reset` may change it for a robot.
    """

    def __init__(self, num_envs: int, std: NDArray[np.float32]) -> None:
        self._std = np.tile(std, (num_envs, 1))
        self._noise = np.zeros((num_envs, BLOCK, len(std)), np.float32)
        self._block = np.full(num_envs, -1)
        """Number of the block of control steps that `_noise` contains, for each of n robots, (n,).

        Blocks are counted from 0 at the start of an episode. The number is -1 before the first noise of an episode is
        drawn.
        """
        self._streams: list[np.random.Generator | None] = [None] * num_envs

    def reset(
        self, env_index: int, stream: np.random.Generator, std: NDArray[np.float32] | float | None = None
    ) -> None:
        """Start an episode of a robot.

        Args:
            env_index: Index of the robot.
            stream: Random stream of the noise.
            std: Standard deviation of each component of a sample, (width,); None keeps the present one.
        """
        if std is not None:
            self._std[env_index] = std
        self._block[env_index] = -1
        self._streams[env_index] = stream

    def at(self, clock: Clock, env_ids: EnvIndices) -> NDArray[np.float32]:
        """Return the noise of k robots, each at its control step.

        Args:
            clock: Number of control steps since the start of the episode, for each of k robots, (k,). The numbers must
                not decrease from call to call.
            env_ids: Indices of the k robots, (k,).

        Returns:
            Noise, (k, width), with one number per component of a sample.
        """
        block = clock // BLOCK
        for env_index in env_ids[self._block[env_ids] != block]:
            noise = self._noise[env_index]
            stream = self._streams[env_index]
            assert stream is not None
            stream.standard_normal(out=noise, dtype=np.float32)
            noise *= self._std[env_index]
        self._block[env_ids] = block
        return self._noise[env_ids, clock % BLOCK]


class Channel:
    """Buffered samples of one sensor of n robots, with its sample rate and delay.

    Args:
        num_envs: Number of robots.
        width: Number of components of a sample.
        rate: Sample rate, Hz; None for the control rate.
        delay: Time from the measurement of a sample until policy and estimator can read it, s.
        control_rate: Control rate, an integer multiple of the sample rate, Hz.
        max_delay_steps: Largest argument `delay_steps` of later calls of `value`, control steps. The buffer is always
            long enough for `delay`.

    Raises:
        ValueError: The control rate is no integer multiple of the sample rate.

    Attributes:
        period: Number of control steps between two samples; sample s is taken at control step s * period.
        delay_steps: Number of control steps from the measurement of a sample until it can be read.
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
        # Sample number s of an episode is stored at the index s modulo the length of this ring buffer.
        # The buffer has room for older samples than `value` reads, because `previous` reads the sample before.
        length = max(max_delay_steps, self.delay_steps) // self.period + 3
        self._samples = np.zeros((length, num_envs, width))

    def record(self, values: Array | NDArray[np.float32], clock: Clock, env_ids: EnvIndices) -> None:
        """Store the values of robots that take a sample in this control step.

        The first sample of an episode fills the whole buffer of a robot.

        Args:
            values: Present readings of k robots, (k, width).
            clock: Number of control steps since the start of the episode, for each of the k robots, (k,).
            env_ids: Indices of the k robots, (k,).
        """
        if self.period == 1:
            self._samples[clock % len(self._samples), env_ids] = values
        else:
            is_due = clock % self.period == 0
            self._samples[clock[is_due] // self.period % len(self._samples), env_ids[is_due]] = values[is_due]
        is_first = clock == 0
        if is_first.any():
            self._samples[:, env_ids[is_first]] = values[is_first]

    def value(self, clock: Clock, env_ids: EnvIndices, delay_steps: int | Clock | None = None) -> Array:
        """Return the newest sample that is at least `delay_steps` control steps old.

        If no sample has this age yet, the result is the first sample of the episode.

        Args:
            clock: Number of control steps since the start of the episode, for each of k robots, (k,).
            env_ids: Indices of the k robots, (k,).
            delay_steps: Minimum age of the sample, control steps, one number or (k,); None for the sensor's delay.

        Returns:
            Sample, (k, width).
        """
        return self._samples[self._sample_index(clock, delay_steps) % len(self._samples), env_ids]

    def previous(self, clock: Clock, env_ids: EnvIndices, delay_steps: int | None = None) -> Array:
        """Return the sample that was taken one sample period before the result of `value`.

        If there is no earlier sample, the result is the first sample of the episode.

        Args:
            clock: Number of control steps since the start of the episode, for each of k robots, (k,).
            env_ids: Indices of the k robots, (k,).
            delay_steps: Minimum age of the sample that `value` returns, control steps; None for the sensor's delay.

        Returns:
            Sample, (k, width).
        """
        return self.value(clock - self.period, env_ids, delay_steps)

    def is_new(self, clock: Clock, delay_steps: int) -> Mask:
        """Return True for each robot with a sample that reaches the age `delay_steps` in this control step.

        Args:
            clock: Number of control steps since the start of the episode, for each of k robots, (k,).
            delay_steps: Age of the sample, control steps.

        Returns:
            Mask of the k robots, (k,).
        """
        is_new: Mask = np.logical_and(clock >= delay_steps, (clock - delay_steps) % self.period == 0)
        return is_new

    def time(self, clock: Clock) -> Array:
        """Return the measurement times of the newest samples that k robots can read after the delay, (k,), s.

        The times are measured from the start of each robot's episode. `clock` is the number of control steps since this
        start, (k,).
        """
        return self._sample_index(clock, None) * self.period / self._control_rate

    @property
    def sample_period(self) -> float:
        """Time between two samples of the sensor, s."""
        return self.period / self._control_rate

    def _sample_index(self, clock: Clock, delay_steps: int | Clock | None) -> NDArray[np.int64]:
        """Return the number of each robot's newest sample that is at least `delay_steps` old, (k,).

        The first sample of an episode has the number 0. `clock` is the number of control steps since the start of the
        episode, for each of k robots, (k,). If `delay_steps` is None, the delay of the sensor is used.
        """
        age = self.delay_steps if delay_steps is None else delay_steps
        index: NDArray[np.int64] = np.maximum((clock - age) // self.period, 0)
        return index


def delay_to_steps(delay: float, control_rate: float) -> int:
    """Convert a `delay`, s, to control steps at the `control_rate`, Hz, rounded up."""
    return math.ceil(delay * control_rate - 1e-9)


class SensorModels:
    """Simulated sensors of n robots, with bias, noise, range, resolution, rate and delay.

    A reading is the true value + bias + noise. Readings are clipped to the range, and joint angles are rounded to
    encoder steps. A foot sensor reads contact if its force is at least the threshold.

    Args:
        robot: Robot, which defines the number of joints and legs and the rated torque.
        suite: Sensors of the robots.
        num_envs: Number of robots.
        control_rate: Control rate, Hz.

    Attributes:
        bias: Bias of every sensor component in the present episode of each robot, in the order of `channels`, (n, 34).
        channels: Sensor name -> buffer of the sensor's samples.
        alignment_delay: Longest delay of IMU, encoders and foot sensors, control steps. Samples of this age are
            available from all of these sensors.
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
        """Draw the sensor biases, and restart the noise, of k robots that start a new episode.

        Args:
            env_ids: Indices of the k robots, (k,).
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
        """Record a sample of each sensor that takes one in this control step.

        Args:
            true_values: Sensor name -> noise-free values, (k, width), in the unit of the sensor.
            clock: Number of control steps since the start of the episode, for each of k robots, (k,).
            env_ids: Indices of the k robots, (k,).
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
        """Compute the mean accelerometer reading of robots that stand still.

        Args:
            up: Unit vector that points up in the world, in the IMU axes of each of k robots, (k, 3).
            env_ids: Indices of the k robots, (k,).

        Returns:
            Specific force plus bias, IMU axes, (k, 3), m/s²; the noise is not included.
        """
        start = self._widths["gyro"]
        return GRAVITY * up + self.bias[env_ids, start : start + self._widths["accelerometer"]]

    def _quantize(self, name: str, readings: Array) -> Array:
        """Convert foot forces, N, to contact (0 or 1), and round joint angles, rad, to encoder steps.

        `name` is the name of the sensor, and `readings` are its values for k robots, (k, width). The readings of other
        sensors are returned unchanged.
        """
        if name == "foot_contact":
            return (readings >= self._contact_threshold).astype(np.float64)
        if name == "joint_position" and self._encoder_step:
            return self._encoder_step * np.rint(readings / self._encoder_step)
        return readings

    def _repeat(self, *value_by_sensor: float) -> Array:
        """Return an array with one number for each of the 34 components of all sensor readings, (34,).

        `value_by_sensor` is one number per sensor, which is repeated for all components of its reading.
        """
        return np.repeat(np.array(value_by_sensor), list(self._widths.values()))
