"""What there is to be measured on n simulated robots."""

from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, EnvIndices, ordered_sum, to_components
from quad_env.config import GRAVITY
from quad_env.physics.energy import sum_foot_forces, touch_sensors
from quad_env.physics.state import rotation_matrix
from quad_env.robots.robot import Robot

_IMU = "imu_angular_velocity", "imu_acceleration", "imu_linear_velocity", "imu_orientation"


def ideal_sensor_names(robot: Robot, model: Any) -> list[str]:
    """MuJoCo's own sensors that are looked at."""
    return [*_IMU, *chain(*touch_sensors(robot, model))]


class IdealSensors:
    """Looks at the present state of a MuJoCo batch, whose model evaluates the sensors `probed`.

    After a step MuJoCo's outputs are those of the state before the last substep. To see the present ones they have to
    be computed again; readers of the last substep get copies.
    """

    def __init__(self, robot: Robot, batch: Any, model: Any, dt: float) -> None:
        self._batch, self._dt, self._joints = batch, dt, slice(-robot.num_joints, None)
        self._sensors = [batch.sensor(name).data for name in _IMU]
        self._touch = [[batch.sensor(name).data for name in names] for names in touch_sensors(robot, model)]
        self._qpos, self._torque = batch.bind("qpos"), batch.bind("qfrc_actuator")
        self._velocity = np.zeros_like(self._sensors[2])
        """Velocity of each IMU at its last sample, world frame, m/s."""
        self._axes = np.zeros((len(self._velocity), 3, 3))
        """Rotation of each IMU at its last sample: from its axes to the world frame."""
        self._copies: list[tuple[Array, Array]] = []

    def measured(self, rows: EnvIndices, clock: NDArray[np.int64], period: int) -> dict[str, Array]:
        """What those robots' sensors would read if they were perfect, of no substep earlier; name -> (k, …).

        In the IMU's axes: `gyro`, rad/s, `accelerometer`, m/s², and `up`, a unit vector; and `joint_position`, rad,
        `foot_contact`, force that presses each foot, N, and `joint_torque`, N·m. To be called once a control step,
        `clock`, (k,), since the start.

        `accelerometer`, sampled every `period` steps, is the mean specific force since the last sample: change of the
        IMU's velocity by time, less gravity. So a foot's impact, over within a substep or two, is neither missed nor
        taken for all the time. MuJoCo's own accelerometer, which implicit integration makes differ from the trunk's
        motion by 2.4 m/s² (rms, vertical) in a trot, is the reading of the first look alone.
        """
        self._batch.forward(rows)
        gyro, acceleration, velocity, orientation = (data[rows] for data in self._sensors)
        axes = np.moveaxis(np.array(rotation_matrix(to_components(orientation))), -1, 0)
        force = (velocity - self._velocity[rows]) / (period * self._dt)
        force[:, 2] += GRAVITY
        half_turned = 0.5 * (self._axes[rows] + axes)
        mean = ordered_sum((half_turned * force[:, :, None]).transpose(1, 0, 2))
        due, first = clock % period == 0, clock == 0
        self._velocity[rows[due]], self._axes[rows[due]] = velocity[due], axes[due]
        return {
            "gyro": gyro,
            "accelerometer": np.where(first[:, None], acceleration, mean),
            "up": axes[:, 2],
            "joint_position": self._qpos[rows, self._joints],
            "foot_contact": sum_foot_forces(self._touch, rows),
            "joint_torque": self._torque[rows, self._joints],
        }

    def copy(self, output: Array) -> Array:
        """A copy of one of the batch's outputs, which follows it at every `keep` alone."""
        self._copies.append((output, output.copy()))
        return self._copies[-1][1]

    def refresh(self, rows: slice | EnvIndices) -> None:
        """Take the outputs of those robots as they are now into the copies."""
        for output, copy in self._copies:
            copy[rows] = output[rows]
