"""Complementary filter: estimates gravity direction and trunk velocity from the robot's own sensors.

Vectors are in the base frame. g is the unit vector of gravity, ω the angular velocity, and f the specific force that
the accelerometer reads. v is the velocity of the trunk's centre, dt the control period, and G is 9.81 m/s². Gravity is
constant in the world frame, so its vector in the base frame changes by dg/dt = g × ω.

Gravity uses the linear form of the complementary filter of Mahony, Hamel and Pflimlin (Nonlinear complementary filters
on the special orthogonal group, IEEE TAC 2008). The centripetal acceleration ω × v is subtracted from f, as in Euston
et al. (A complementary filter for attitude estimation of a fixed-wing UAV, IROS 2008):

    g ← g + dt g × ω,    g ← g + dt/TILT_TIME ((ω × v - f)/G - g),    g ← g/|g|

The filter neither normalises f nor rejects large or small values of f. Gravity follows from the mean of f over strides,
and both operations would bias this mean (0.06 rad in a trot). A steady linear acceleration appears as a tilt.

The velocity follows dv/dt = f + G g - ω × v. Leg odometry corrects the velocity, because the contact points of stance
feet are at rest (Bloesch et al., State estimation for legged robots, RSS 2012). Here the correction has a constant
gain. v_legs is the velocity from leg odometry, and t the time to which it belongs:

    v ← v + dt (f + G g - ω × v),    v ← v + dt/VELOCITY_TIME (v_legs - v(t))
"""

from typing import NamedTuple

import numpy as np

from quad_env.columns import Array, EnvIndices, Mask, ordered_sum
from quad_env.config import GRAVITY
from quad_env.robots.kinematics import foot_positions
from quad_env.robots.robot import Robot

TILT_TIME = 2.0
"""Time constant with which the accelerometer corrects the gravity vector that the gyroscope integrates, s.

A constant gyroscope bias b, rad/s, causes a tilt error of about b · TILT_TIME, rad. Of 1, 2 and 4 s, 4 s gave the best
estimate for sensors without biases. With biases, 2 s halves the tilt error that 4 s would give.
"""
VELOCITY_TIME = 0.1
"""Time constant with which leg odometry corrects the velocity from the integrated acceleration, s.

Of 0.02, 0.05, 0.1, 0.2 and 0.4 s, this time constant gave the best velocity estimate in a trot.
"""


class AlignedReadings(NamedTuple):
    """Sensor readings of k robots that were all taken at the same time; the input of the estimators."""

    gyro: Array
    """Angular velocity that the gyroscopes of k robots read, base frame, (k, 3), rad/s."""
    accelerometer: Array
    """Specific force that the accelerometers of k robots read, base frame, (k, 3), m/s²."""
    joints: Array
    """Joint angles that the encoders of k robots read, (k, 12), rad."""
    previous_joints: Array
    """Joint angles in the encoder sample before `joints`, for each of k robots, (k, 12), rad."""
    sustained_contact: Mask
    """True for each foot of k robots that reads contact in this and in the previous foot sensor sample, (k, 4)."""
    contact: Mask
    """True for each foot of k robots that reads contact in this sample of the foot sensors, (k, 4)."""
    has_new_angles: Mask
    """True for each of k robots that has got a new encoder sample since the last control step, (k,)."""

    def select(self, mask: Mask) -> "AlignedReadings":
        """Return only the readings of the robots for which `mask` is True, with one item per robot, (k,)."""
        if mask.all():
            return self
        return AlignedReadings._make(readings[mask] for readings in self)


class ComplementaryFilter:
    """Complementary filter that estimates gravity and velocity of n robots in the base frame.

    The estimates belong to the time of the readings, which is earlier than the present time by the longest sensor
    delay.

    Args:
        robot: Geometry of the robots.
        num_envs: Number of robots.
        dt: Control period, s.
        encoder_period: Time between two encoder samples, s.

    Attributes:
        gravity: Unit vector of gravity, (n, 3).
        velocity: Velocity of the trunk's centre, (n, 3), m/s.
        gyro_bias: Estimated gyroscope bias, (n, 3), rad/s; always 0, because this filter does not estimate the bias.
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
        """Reset the estimates of robots that stand still at the start of an episode.

        Args:
            env_ids: Indices of the k robots, (k,).
            specific_force: Mean accelerometer reading while the robots stand still, base frame, (k, 3), m/s².
            readings: First sensor readings of the episode, of the k robots.
        """
        self.gravity[env_ids] = -unit(specific_force)
        self.velocity[env_ids] = 0.0
        self._gyro[env_ids] = readings.gyro

    def update(self, readings: AlignedReadings, env_ids: EnvIndices) -> None:
        """Advance the estimates of k robots by one control period.

        Args:
            readings: Time-aligned readings of k robots at the end of the period.
            env_ids: Indices of the k robots, (k,).
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
        """Correct the velocity by leg odometry, and return it, base frame, (k, 3), m/s.

        The velocity of a robot stays unchanged if none of its feet is in contact. All vectors of the k robots are in
        the base frame, (k, 3): trunk `velocity`, m/s, `acceleration`, m/s², `angular_velocity`, rad/s, and the unit
        vector of `gravity`.
        """
        period = self._encoder_period
        leg_velocity, is_known = leg_odometry_velocity(self._robot, readings, angular_velocity, gravity, period)
        error = leg_velocity - (velocity - 0.5 * period * acceleration)
        return np.where(is_known, velocity + min(1.0, self._dt / VELOCITY_TIME) * error, velocity)


def leg_odometry_velocity(
    robot: Robot, readings: AlignedReadings, angular_velocity: Array, gravity: Array, encoder_period: float
) -> tuple[Array, Mask]:
    """Compute the velocity of the trunk's centre from the feet in contact (leg odometry).

    A foot is a ball of radius r that rolls on the ground: its centre moves with velocity ω_calf × (-r g). ω_calf is the
    angular velocity of the calf, and g the unit vector of gravity. p is the position of the foot's centre relative to
    the trunk's centre. The velocity of the trunk's centre is v = ω_calf × (-r g) - ω × p - dp/dt. The result is the
    mean of v over the feet in contact, at the time midway between the last two encoder samples.

    Args:
        robot: Geometry of the robots.
        readings: Readings of k robots.
        angular_velocity: Angular velocity ω of the trunk, base frame, (k, 3), rad/s.
        gravity: Unit vector g of gravity, base frame, (k, 3).
        encoder_period: Time between the two encoder samples, s.

    Returns:
        velocity: Velocity of the trunk's centre, base frame, (k, 3), m/s.
        is_known: True for robots with at least one foot in contact, (k, 1).
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
    """Compute the angular velocity of each calf midway between two samples, base frame, (k, 4, 3), rad/s.

    `joints` and `previous_joints` are the joint angles of k robots in the two samples, (k, 4, 3), rad. The time between
    the samples is `period`, s. `angular_velocity` is the angular velocity of the trunk, base frame, (k, 3), rad/s.
    """
    speed = (joints - previous_joints) / period
    hip = 0.5 * (joints + previous_joints)[..., 0]
    bend = speed[..., 1] + speed[..., 2]
    relative = np.stack((speed[..., 0], bend * np.cos(hip), bend * np.sin(hip)), axis=-1)
    out: Array = angular_velocity[:, None] + relative
    return out


def unit(vectors: Array) -> Array:
    """Divide each of the `vectors`, (…, 3), by its length, and return the unit vectors."""
    x = vectors[..., 0]
    y = vectors[..., 1]
    z = vectors[..., 2]
    length = np.sqrt(x * x + y * y + z * z)
    return vectors / np.maximum(length, 1e-6)[..., None]
