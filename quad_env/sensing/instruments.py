"""Sensor models of n robots: true values in, biased, noisy, sampled and delayed readings out."""

from collections.abc import Mapping, Sequence

import numpy as np

from quad_env.columns import Array, EnvIndices
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.scenarios.episode import EpisodeSample
from quad_env.sensing.channel import Channel, Clock, Noise, delay_to_steps
from quad_env.sensing.suite import SensorSuite


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
