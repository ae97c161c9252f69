"""Noise-free sensor values of the simulated robots, at the present state."""

from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, EnvIndices, ordered_sum, to_components
from quad_env.config import GRAVITY
from quad_env.physics.energy import sum_foot_forces, touch_sensors
from quad_env.physics.state import rotation_matrix
from quad_env.robots.robot import Robot

_IMU_SENSORS = ("imu_angular_velocity", "imu_acceleration", "imu_linear_velocity", "imu_orientation")


def ideal_sensor_names(robot: Robot, model: Any) -> list[str]:
    """Return the names of the MuJoCo sensors that `IdealSensors` reads.

    Args:
        robot: Robot of the model.
        model: Compiled `mujoco.MjModel`.

    Returns:
        Names.
    """
    return [*_IMU_SENSORS, *chain(*touch_sensors(robot, model))]


class IdealSensors:
    """Reads the present state of a batch; its model evaluates the sensors of `ideal_sensor_names`.

    After a step MuJoCo's outputs belong to the state before the last physics step. The outputs of the present state are
    computed here; readers of the last physics step get copies from `copy`.

    Args:
        robot: Robot of the model.
        batch: Batch of the robots.
        model: Compiled `mujoco.MjModel`.
        dt: Control period, s.
    """

    def __init__(self, robot: Robot, batch: Any, model: Any, dt: float) -> None:
        self._batch = batch
        self._dt = dt
        self._joints = slice(-robot.num_joints, None)
        self._imu = [batch.sensor(name).data for name in _IMU_SENSORS]
        self._touch = [[batch.sensor(name).data for name in names] for names in touch_sensors(robot, model)]
        self._qpos = batch.bind("qpos")
        self._torque = batch.bind("qfrc_actuator")
        num_envs = len(self._qpos)
        self._velocity = np.zeros((num_envs, 3))
        """Velocity of each IMU at its last sample, world frame, (n, 3), m/s."""
        self._rotation = np.zeros((num_envs, 3, 3))
        """Rotation from the axes of each IMU to the world frame at its last sample, (n, 3, 3)."""
        self._copies: list[tuple[Array, Array]] = []
        """Outputs of the batch and their copies."""

    def read(self, env_ids: EnvIndices, clock: NDArray[np.int64], period: int) -> dict[str, Array]:
        """Return the values of perfect sensors at the present state; call it once per control step.

        `accelerometer` is the mean specific force since its last sample: the change of the IMU's velocity divided by
        the time, minus gravity. So the impact of a foot, which takes one or two physics steps, is neither missed nor
        taken for the whole period. The first reading is MuJoCo's own accelerometer. In a trot that one differs from the
        trunk's motion by 2.4 m/s² (rms, vertical) because of implicit integration.

        Args:
            env_ids: Indices of the robots, (k,).
            clock: Control steps since their start, (k,).
            period: Control steps between two samples of the accelerometer.

        Returns:
            gyro: Angular velocity, IMU axes, (k, 3), rad/s.
            accelerometer: Specific force, IMU axes, (k, 3), m/s².
            up: Unit vector of the vertical, IMU axes, (k, 3).
            joint_position: (k, 12), rad.
            foot_contact: Ground force on each foot, (k, 4), N.
            joint_torque: (k, 12), N·m.
        """
        self._batch.forward(env_ids)
        gyro, acceleration, velocity, orientation = (data[env_ids] for data in self._imu)
        rotation = np.moveaxis(np.array(rotation_matrix(to_components(orientation))), -1, 0)
        mean_force = self._mean_specific_force(env_ids, velocity, rotation, period)
        is_due = clock % period == 0
        self._velocity[env_ids[is_due]] = velocity[is_due]
        self._rotation[env_ids[is_due]] = rotation[is_due]
        is_first = clock == 0
        return {
            "gyro": gyro,
            "accelerometer": np.where(is_first[:, None], acceleration, mean_force),
            "up": rotation[:, 2],
            "joint_position": self._qpos[env_ids, self._joints],
            "foot_contact": sum_foot_forces(self._touch, env_ids),
            "joint_torque": self._torque[env_ids, self._joints],
        }

    def _mean_specific_force(self, env_ids: EnvIndices, velocity: Array, rotation: Array, period: int) -> Array:
        """Return the mean specific force since the last sample, IMU axes, (k, 3), m/s²."""
        force_world = (velocity - self._velocity[env_ids]) / (period * self._dt)
        force_world[:, 2] += GRAVITY
        mean_rotation = 0.5 * (self._rotation[env_ids] + rotation)
        return ordered_sum((mean_rotation * force_world[:, :, None]).transpose(1, 0, 2))

    def copy(self, output: Array) -> Array:
        """Return a copy of an `output` of the batch; every `refresh` updates it."""
        copy = output.copy()
        self._copies.append((output, copy))
        return copy

    def refresh(self, env_ids: slice | EnvIndices) -> None:
        """Update the copies of the robots `env_ids` to the outputs of their last physics step."""
        for output, copy in self._copies:
            copy[env_ids] = output[env_ids]
