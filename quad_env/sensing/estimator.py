"""Complementary filter: direction of gravity and velocity of the trunk from the robot's own sensors.

Vectors are in the base frame. g is the unit vector of gravity, ω the angular velocity, f the specific force, v the
velocity of the trunk's centre, and G 9.81 m/s². A vector that is constant in the world frame turns in the base frame by
dg/dt = g × ω.

Gravity uses the linear form of the complementary filter of Mahony, Hamel and Pflimlin (Nonlinear complementary filters
on the special orthogonal group, IEEE TAC 2008). The centripetal part of the force is subtracted as by Euston et al. (A
complementary filter for attitude estimation of a fixed-wing UAV, IROS 2008):

    g ← g + dt g × ω,    g ← g + dt/TILT_TIME ((ω × v - f)/G - g),    g ← g/|g|

The force is neither normalised nor rejected by its size, because its mean over strides gives gravity and either would
bias it (0.06 rad in a trot). A steady linear acceleration appears as a tilt.

Velocity: dv/dt = f + G g - ω × v, corrected by the stance feet, because their contact point rests (Bloesch et al.,
State estimation for legged robots, RSS 2012, as a filter with a constant gain):

    v ← v + dt (f + G g - ω × v),    v ← v + dt/VELOCITY_TIME (v_legs - v(at the time of v_legs))
"""

from typing import NamedTuple

import numpy as np

from quad_env.columns import Array, EnvIndices, Mask, ordered_sum
from quad_env.config import GRAVITY
from quad_env.robots.kinematics import foot_positions
from quad_env.robots.robot import Robot

TILT_TIME = 2.0
"""s. Time constant with which the accelerometer corrects the gyroscope; of 1, 2 and 4 s, 4 s is best without biases."""
VELOCITY_TIME = 0.1
"""s. Time constant with which stance feet correct the accelerometer; best of 0.02, 0.05, 0.1, 0.2 and 0.4 s in a
trot."""


class AlignedReadings(NamedTuple):
    """Sensor readings of k robots that were taken at the same time; `SensorObservation` makes them."""

    gyro: Array
    """Angular velocity, (k, 3), rad/s."""
    accelerometer: Array
    """Specific force, (k, 3), m/s²."""
    joints: Array
    """Joint angles, (k, 12), rad."""
    previous_joints: Array
    """Joint angles one encoder sample earlier, (k, 12), rad."""
    sustained_contact: Mask
    """Feet in contact at this and at the previous sample of their sensors, (k, 4)."""
    contact: Mask
    """Feet in contact at this sample, (k, 4)."""
    has_new_angles: Mask
    """True where the encoder sample is a new one, (k,)."""

    def select(self, mask: Mask) -> "AlignedReadings":
        """Return the readings of the robots where the mask, (k,), is True."""
        return AlignedReadings._make(readings[mask] for readings in self)


class ComplementaryFilter:
    """Estimates of n robots by a complementary filter, base frame, at the time that all sensors have reported.

    Args:
        robot: Geometry of the robots.
        num_envs: Number of robots.
        dt: Control period, s.
        encoder_period: Time between two encoder samples, s.

    Attributes:
        gravity: Unit vector of gravity, (n, 3).
        velocity: Velocity of the trunk's centre, (n, 3), m/s.
        gyro_bias: Always 0: this filter estimates no bias, (n, 3), rad/s.
    """

    def __init__(self, robot: Robot, num_envs: int, dt: float, encoder_period: float) -> None:
        self._robot = robot
        self._dt = dt
        self._encoder_period = encoder_period
        self.gravity = np.zeros((num_envs, 3))
        self.velocity = np.zeros((num_envs, 3))
        self.gyro_bias = np.zeros((num_envs, 3))
        self._gyro = np.zeros((num_envs, 3))

    def reset(self, env_ids: EnvIndices, specific_force: Array, readings: AlignedReadings) -> None:
        """Reset the filter of some robots, which are at rest.

        Args:
            env_ids: Indices of the robots, (k,).
            specific_force: Accelerometer mean at rest, base frame, (k, 3), m/s².
            readings: First readings of these robots.
        """
        self.gravity[env_ids] = -unit(specific_force)
        self.velocity[env_ids] = 0.0
        self._gyro[env_ids] = readings.gyro

    def update(self, readings: AlignedReadings, env_ids: EnvIndices) -> None:
        """Advance the estimates of some robots by one control period.

        Args:
            readings: Time-aligned readings of k robots at the end of the period.
            env_ids: Their indices, (k,).
        """
        dt = self._dt
        velocity = self.velocity[env_ids]
        angular_velocity = 0.5 * (self._gyro[env_ids] + readings.gyro)
        self._gyro[env_ids] = readings.gyro
        gravity = self.gravity[env_ids]
        gravity = unit(gravity + dt * np.cross(gravity, angular_velocity))
        acceleration = readings.accelerometer + GRAVITY * gravity - np.cross(angular_velocity, velocity)
        velocity = velocity + dt * acceleration
        velocity = self._correct_velocity(velocity, acceleration, readings, angular_velocity, gravity)
        measured_gravity = (np.cross(readings.gyro, velocity) - readings.accelerometer) / GRAVITY
        gravity = gravity + dt / TILT_TIME * (measured_gravity - gravity)
        self.gravity[env_ids] = unit(gravity)
        self.velocity[env_ids] = velocity

    def _correct_velocity(
        self, velocity: Array, acceleration: Array, readings: AlignedReadings, angular_velocity: Array, gravity: Array
    ) -> Array:
        """Return the velocity corrected by leg odometry, (k, 3), m/s; unchanged without a foot in contact."""
        period = self._encoder_period
        leg_velocity, is_known = leg_odometry_velocity(self._robot, readings, angular_velocity, gravity, period)
        error = leg_velocity - (velocity - 0.5 * period * acceleration)
        return np.where(is_known, velocity + min(1.0, self._dt / VELOCITY_TIME) * error, velocity)


def leg_odometry_velocity(
    robot: Robot, readings: AlignedReadings, angular_velocity: Array, gravity: Array, encoder_period: float
) -> tuple[Array, Mask]:
    """Compute the velocity of the trunk's centre from the feet in contact (leg odometry).

    The velocity is the one midway between the two encoder samples. The foot is a ball that rolls: its centre p moves
    with ω_calf × (-r g), so v = ω_calf × (-r g) - ω × p - dp/dt, averaged over the feet in contact.

    Args:
        robot: Geometry of the robots.
        readings: Readings of k robots.
        angular_velocity: ω, base frame, (k, 3), rad/s.
        gravity: Unit vector of gravity, base frame, (k, 3).
        encoder_period: Time between the two encoder samples, s.

    Returns:
        velocity: Base frame, (k, 3), m/s.
        is_known: False where no foot is in contact, (k, 1).
    """
    joints = readings.joints.reshape(-1, len(robot.leg_names), 3)
    previous_joints = readings.previous_joints.reshape(joints.shape)
    feet = foot_positions(robot, joints)
    previous_feet = foot_positions(robot, previous_joints)
    calf_velocity = _calf_angular_velocity(joints, previous_joints, angular_velocity, encoder_period)
    rolling_velocity = np.cross(calf_velocity, -robot.foot_radius * gravity[:, None])
    lever = robot.hip_positions + 0.5 * (feet + previous_feet)
    foot_velocity = (feet - previous_feet) / encoder_period
    leg_velocities = rolling_velocity - np.cross(angular_velocity[:, None], lever) - foot_velocity
    weight = readings.sustained_contact.astype(np.float64)
    count = ordered_sum(weight.T)[:, None]
    velocity_sum = ordered_sum((weight[..., None] * leg_velocities).transpose(1, 0, 2))
    return velocity_sum / np.maximum(count, 1.0), count > 0


def _calf_angular_velocity(joints: Array, previous_joints: Array, angular_velocity: Array, period: float) -> Array:
    """Return the angular velocity of the calves midway between samples, base frame, (k, 4, 3), rad/s."""
    speed = (joints - previous_joints) / period
    hip = 0.5 * (joints + previous_joints)[..., 0]
    bend = speed[..., 1] + speed[..., 2]
    relative = np.stack((speed[..., 0], bend * np.cos(hip), bend * np.sin(hip)), axis=-1)
    out: Array = angular_velocity[:, None] + relative
    return out


def unit(vectors: Array) -> Array:
    """Return the vectors, (…, 3), scaled to length one."""
    x = vectors[..., 0]
    y = vectors[..., 1]
    z = vectors[..., 2]
    length = np.sqrt(x * x + y * y + z * z)
    return vectors / np.maximum(length, 1e-6)[..., None]
