"""Reader of the noise-free sensor values (IMU, joints, foot forces) of simulated robots."""

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
        Names of the IMU's sensors and of the touch sensors of the feet.
    """
    return [*_IMU_SENSORS, *chain(*touch_sensors(robot, model))]


class IdealSensors:
    """Reader of noise-free sensor values of n robots at the present state; sensor models add errors to them.

    After a step MuJoCo's outputs belong to the state before the last physics step. `read` computes the outputs again
    for the present state, and so overwrites the outputs. Code that needs the outputs of the last physics step calls
    `copy`.

    Args:
        robot: Robot of the model.
        batch: Batch of the robots; its model must evaluate the sensors of `ideal_sensor_names`.
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
        """Velocity of each IMU at the last accelerometer sample, world frame, (n, 3), m/s."""
        self._rotation = np.zeros((num_envs, 3, 3))
        """Rotation matrix from IMU axes to world frame at the last accelerometer sample, (n, 3, 3)."""
        self._copies: list[tuple[Array, Array]] = []
        """Pairs of a simulator output and its copy; `refresh` copies the output of the last physics step."""

    def read(self, env_ids: EnvIndices, clock: NDArray[np.int64], period: int) -> dict[str, Array]:
        """Return noise-free sensor values at the present state; call this method once per control step.

        `accelerometer` is the mean specific force since its last sample: the change of the IMU's velocity divided by
        the time, minus gravity. The impact of a foot takes only one or two physics steps. A mean includes the impact
        with its correct weight, but a single value would miss it or count it for the whole period. Only the first
        sample of an episode is the value of MuJoCo's accelerometer sensor. Implicit integration makes this value differ
        from the motion of the trunk, in a trot by 2.4 m/s² (root mean square, vertical).

        Args:
            env_ids: Indices of the robots, (k,).
            clock: Control steps of these robots since the start of their episodes, (k,).
            period: Control steps between two samples of the accelerometer.

        Returns:
            gyro: Angular velocity, IMU axes, (k, 3), rad/s.
            accelerometer: Specific force, IMU axes, (k, 3), m/s².
            up: Unit vector of the vertical, IMU axes, (k, 3).
            joint_position: Joint angles, (k, 12), rad.
            foot_contact: Ground force on each foot, (k, 4), N.
            joint_torque: Joint torques of the servos, (k, 12), N·m.
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
        """Return the mean specific force since the last accelerometer sample, IMU axes, (k, 3), m/s².

        `velocity` is the present velocity of the IMU, world frame, (k, 3), m/s. `rotation` is the present rotation
        matrix from IMU axes to world frame, (k, 3, 3). `period` is the time between samples, control steps.
        """
        force_world = (velocity - self._velocity[env_ids]) / (period * self._dt)
        force_world[:, 2] += GRAVITY
        mean_rotation = 0.5 * (self._rotation[env_ids] + rotation)
        return ordered_sum((mean_rotation * force_world[:, :, None]).transpose(1, 0, 2))

    def copy(self, output: Array) -> Array:
        """Return a copy of a simulator output, (n, ...), that every call of `refresh` updates."""
        copy = output.copy()
        self._copies.append((output, copy))
        return copy

    def refresh(self, env_ids: slice | EnvIndices) -> None:
        """Update all arrays from `copy` with the outputs of the last physics step of the robots `env_ids`."""
        for output, copy in self._copies:
            copy[env_ids] = output[env_ids]
