"""The sensors of n robots: from what is there to be measured to what they read."""

from collections.abc import Mapping, Sequence

import numpy as np

from quad_env.columns import Array, EnvIndices
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.scenarios.episode import EpisodeSample
from quad_env.sensing.channel import Channel, Clock, Noise, delay_to_steps
from quad_env.sensing.suite import SensorSuite


class SensorModels:
    """Bias, noise, range, resolution, rate and delay of n robots' sensors.

    What they read is `measured` + bias + noise, then cut to the range or rounded to a step; a foot stands where that is
    its threshold or more.
    """

    def __init__(self, robot: Robot, suite: SensorSuite, num_envs: int, control_rate: float) -> None:
        imu, encoders, feet, torque = suite.imu, suite.encoders, suite.feet, suite.torque
        n, legs = robot.num_joints, len(robot.leg_names)
        self._widths = {"gyro": 3, "accelerometer": 3, "joint_position": n, "foot_contact": legs, "joint_torque": n}
        before = self._widths["gyro"] + self._widths["accelerometer"]
        self._encoders = slice(before, before + n)
        largest_torque = robot.rated_torque if torque.range is None else torque.range
        self._bias_deviation = self._each(imu.gyro_bias, imu.accelerometer_bias, encoders.zero_offset, 0.0, torque.bias)
        deviation = self._each(imu.gyro_noise, imu.accelerometer_noise, encoders.noise, feet.noise, torque.noise)
        self._range = self._each(imu.gyro_range, imu.accelerometer_range, np.inf, np.inf, largest_torque)
        self._step, self._threshold = encoders.step, feet.threshold
        self.bias = np.zeros((num_envs, len(deviation)))
        """Biases of each robot's present episode, in the order of the channels."""
        self._noise = Noise(num_envs, deviation.astype(np.float32))
        makers = dict(zip(self._widths, (imu, imu, encoders, feet, torque), strict=True))
        self.alignment_delay = max(delay_to_steps(each.delay, control_rate) for each in (imu, encoders, feet))
        """Control steps back to the moment of which all sensors of motion and contact have reported."""
        self.channels = {
            name: Channel(num_envs, self._widths[name], made.rate, made.delay, control_rate, self.alignment_delay)
            for name, made in makers.items()
        }

    def reset(self, rows: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Start these episodes of those robots."""
        for row, episode in zip(rows, episodes, strict=True):
            stream = episode.streams.sensors
            self.bias[row] = self._bias_deviation * stream.standard_normal(len(self._bias_deviation))
            if episode.randomised is not None:
                self.bias[row, self._encoders] += episode.randomised.encoder_offset
            self._noise.reset(row, stream)

    def read(self, measured: Mapping[str, Array], clock: Clock, rows: EnvIndices) -> None:
        """Let those robots' sensors sample what is there, name -> (k, width), if they are due."""
        values = np.concatenate([measured[name] for name in self._widths], axis=1)
        values += self.bias[rows] + self._noise.at(clock, rows)
        np.clip(values, -self._range, self._range, out=values)
        start = 0
        for name, width in self._widths.items():
            self.channels[name].record(self._quantize(name, values[:, start : start + width]), clock, rows)
            start += width

    def at_rest(self, up: Array, rows: EnvIndices) -> Array:
        """What those robots' accelerometers read of a long rest, m/s², (k, 3), `up`, (k, 3), being up in their axes."""
        start = self._widths["gyro"]
        return GRAVITY * up + self.bias[rows, start : start + self._widths["accelerometer"]]

    def _quantize(self, name: str, values: Array) -> Array:
        if name == "foot_contact":
            return (values >= self._threshold).astype(np.float64)
        if name == "joint_position" and self._step:
            return self._step * np.rint(values / self._step)
        return values

    def _each(self, *of_sensor: float) -> Array:
        """A value of each sensor's entries, (34,)."""
        return np.repeat(np.array(of_sensor), list(self._widths.values()))
