"""The sensors of n robots: from what is there to be measured to what they read."""

from collections.abc import Mapping, Sequence

import numpy as np

from quad_env.columns import Array, Rows
from quad_env.config import GRAVITY
from quad_env.robots.robot import LEG_NAMES, NUM_JOINTS
from quad_env.scenarios.episode import Episode
from quad_env.sensing.channel import Channel, Clock, steps_late
from quad_env.sensing.noise import Noise
from quad_env.sensing.suite import SensorSuite

WIDTHS = {
    "gyro": 3,
    "accelerometer": 3,
    "joint_position": NUM_JOINTS,
    "foot_contact": len(LEG_NAMES),
    "joint_torque": NUM_JOINTS,
}
"""Entries of each sensor, in the order in which their biases and noise are drawn."""
_COUNT = sum(WIDTHS.values())


class Instruments:
    """Bias, noise, range, resolution, rate and delay of n robots' sensors.

    What they read is `measured` + bias + noise, then cut to the range or rounded to a step; a foot stands where that is
    its threshold or more.
    """

    def __init__(self, suite: SensorSuite, num_envs: int, control_rate: float) -> None:
        imu, encoders, feet, torque = suite.imu, suite.encoders, suite.feet, suite.torque
        self._bias_deviation = _each(imu.gyro_bias, imu.accelerometer_bias, encoders.zero_offset, 0.0, torque.bias)
        deviation = _each(imu.gyro_noise, imu.accelerometer_noise, encoders.noise, feet.noise, torque.noise)
        self._range = _each(imu.gyro_range, imu.accelerometer_range, np.inf, np.inf, torque.range)
        self._step, self._threshold = encoders.step, feet.threshold
        self.bias = np.zeros((num_envs, _COUNT))
        """Of each robot's present episode, in the order of WIDTHS."""
        self._noise = Noise(num_envs, deviation.astype(np.float32))
        makers = dict(zip(WIDTHS, (imu, imu, encoders, feet, torque), strict=True))
        self.aligned = max(steps_late(each.delay, control_rate) for each in (imu, encoders, feet))
        """Control steps back to the moment of which all sensors of motion and contact have reported."""
        self.channels = {
            name: Channel(num_envs, WIDTHS[name], made.rate, made.delay, control_rate, self.aligned)
            for name, made in makers.items()
        }

    def begin(self, rows: Rows, episodes: Sequence[Episode]) -> None:
        """Those robots start these episodes."""
        for row, episode in zip(rows, episodes, strict=True):
            stream = episode.streams.sensors
            self.bias[row] = self._bias_deviation * stream.standard_normal(_COUNT)
            self._noise.begin(row, stream)

    def read(self, measured: Mapping[str, Array], clock: Clock, rows: Rows) -> None:
        """Let those robots' sensors sample what is there, name -> (k, width), if they are due."""
        values = np.concatenate([measured[name] for name in WIDTHS], axis=1)
        values += self.bias[rows] + self._noise.at(clock, rows)
        np.clip(values, -self._range, self._range, out=values)
        start = 0
        for name, width in WIDTHS.items():
            self.channels[name].take(self._as_read(name, values[:, start : start + width]), clock, rows)
            start += width

    def at_rest(self, up: Array, rows: Rows) -> Array:
        """What those robots' accelerometers read of a long rest, m/s², (k, 3), `up`, (k, 3), being up in their axes."""
        start = WIDTHS["gyro"]
        force: Array = GRAVITY * up + self.bias[rows, start : start + WIDTHS["accelerometer"]]
        return force

    def _as_read(self, name: str, values: Array) -> Array:
        if name == "foot_contact":
            return (values >= self._threshold).astype(np.float64)
        if name == "joint_position" and self._step:
            return self._step * np.rint(values / self._step)
        return values


def _each(*of_sensor: float) -> Array:
    """A value of each sensor's entries, (34,)."""
    return np.repeat(np.array(of_sensor), list(WIDTHS.values()))
