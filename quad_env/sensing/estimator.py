"""Gravity's direction and the trunk's velocity, estimated from what sensors read.

Vectors are in the base frame: g the unit vector of gravity, ω angular velocity, f specific force, v velocity of the
trunk's centre, G 9.81 m/s². A vector that is constant in the world turns in the base frame by dg/dt = g × ω.

Gravity, the linear form of the complementary filter of Mahony, Hamel and Pflimlin (Nonlinear complementary filters on
the special orthogonal group, IEEE TAC 2008), with the centripetal part of the force taken out as by Euston et al. (A
complementary filter for attitude estimation of a fixed-wing UAV, IROS 2008):

    g ← g + dt g × ω,    g ← g + dt/TILT_TIME ((ω × v - f)/G - g),    g ← g/|g|

The force is not normalised first, and none is left out for its size: over strides the mean of f gives gravity,
and either would bend it (0.06 rad in a trot). A steady acceleration along a line is taken for a tilt.

Velocity: dv/dt = f + G g - ω × v, corrected by the standing feet, of which the point on the ground rests (Bloesch et
al., State estimation for legged robots, RSS 2012, in the form of a filter with a constant gain):

    v ← v + dt (f + G g - ω × v),    v ← v + dt/VELOCITY_TIME (v_legs - v(when the legs say so))
"""

from typing import NamedTuple

import numpy as np

from quad_env.columns import Array, EnvIndices, Mask, ordered_sum
from quad_env.config import GRAVITY
from quad_env.robots.kinematics import foot_positions
from quad_env.robots.robot import Robot

TILT_TIME = 2.0
"""s over which the accelerometer corrects the gyroscope; of 1, 2 and 4 s, 4 s is the best without biases."""
VELOCITY_TIME = 0.1
"""s over which standing feet correct the accelerometer; the best of 0.02, 0.05, 0.1, 0.2 and 0.4 s on a trot."""


class AlignedReadings(NamedTuple):
    """Readings of k robots that belong together."""

    gyro: Array
    """rad/s, (k, 3)"""
    accelerometer: Array
    """m/s², (k, 3)"""
    joints: Array
    """rad, (k, 12)"""
    joints_before: Array
    """rad, one sample of the encoders earlier, (k, 12)"""
    standing: Mask
    """Feet that stood at both, (k, 4)"""
    contact: Mask
    """Feet that stand at the later one, (k, 4)"""
    fresh: Mask
    """Whose sample of the encoders is new, (k,)"""

    def of(self, which: Mask) -> "AlignedReadings":
        """Readings of some of the robots."""
        return AlignedReadings._make(readings[which] for readings in self)


class ComplementaryFilter:
    """Estimates of n robots, base frame, moved on by `dt`, s, at a time; `spacing`, s, is between encoder samples.

    They are of the moment that all sensors have reported; what the gyroscope says is taken as it is.
    """

    def __init__(self, robot: Robot, num_envs: int, dt: float, spacing: float) -> None:
        self._robot, self._dt, self._spacing = robot, dt, spacing
        self.gravity = np.zeros((num_envs, 3))
        """Unit vectors"""
        self.velocity = np.zeros((num_envs, 3))
        """Velocity of the trunk's centre, m/s"""
        self.gyro_bias = np.zeros((num_envs, 3))
        """Not looked for: 0 rad/s"""
        self._gyro = np.zeros((num_envs, 3))

    def reset(self, rows: EnvIndices, at_rest: Array, read: AlignedReadings) -> None:
        """Start of those robots, whose accelerometers read so before, (k, 3), when they stood still."""
        self.gravity[rows], self.velocity[rows], self._gyro[rows] = -unit(at_rest), 0.0, read.gyro

    def update(self, read: AlignedReadings, rows: EnvIndices) -> None:
        """One `dt` later those robots' sensors read this."""
        dt, gravity, velocity = self._dt, self.gravity[rows], self.velocity[rows]
        turning = 0.5 * (self._gyro[rows] + read.gyro)
        self._gyro[rows] = read.gyro
        gravity = unit(gravity + dt * np.cross(gravity, turning))
        acceleration = read.accelerometer + GRAVITY * gravity - np.cross(turning, velocity)
        velocity = velocity + dt * acceleration
        by_feet, known = leg_odometry_velocity(self._robot, read, turning, gravity, self._spacing)
        error = by_feet - (velocity - 0.5 * self._spacing * acceleration)
        velocity = np.where(known, velocity + min(1.0, dt / VELOCITY_TIME) * error, velocity)
        measured = (np.cross(read.gyro, velocity) - read.accelerometer) / GRAVITY
        gravity = gravity + dt / TILT_TIME * (measured - gravity)
        self.gravity[rows], self.velocity[rows] = unit(gravity), velocity


def leg_odometry_velocity(
    robot: Robot, read: AlignedReadings, turning: Array, gravity: Array, spacing: float
) -> tuple[Array, Mask]:
    """Velocity of the trunk's centre by its standing feet, m/s, (k, 3), and of whom it is known, (k, 1).

    It is that of the middle between the two samples of the encoders. The foot is a ball that rolls: its centre p moves
    with ω_calf × (-r g), so v = ω_calf × (-r g) - ω × p - dp/dt, averaged over the feet that stand.
    """
    shape = (-1, len(robot.leg_names), 3)
    joints, before = read.joints.reshape(shape), read.joints_before.reshape(shape)
    now, then = foot_positions(robot, joints), foot_positions(robot, before)
    speed = (joints - before) / spacing
    hip, bend = 0.5 * (joints + before)[..., 0], speed[..., 1] + speed[..., 2]
    calf = turning[:, None] + np.stack((speed[..., 0], bend * np.cos(hip), bend * np.sin(hip)), axis=-1)
    foot = robot.hip_positions + 0.5 * (now + then)
    rolled = np.cross(calf, -robot.foot_radius * gravity[:, None])
    each = rolled - np.cross(turning[:, None], foot) - (now - then) / spacing
    standing = read.standing.astype(np.float64)
    count = ordered_sum(standing.T)[:, None]
    summed = ordered_sum((standing[..., None] * each).transpose(1, 0, 2))
    return summed / np.maximum(count, 1.0), count > 0


def unit(vectors: Array) -> Array:
    """Vectors of length one in the last axis, (…, 3)."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    length = np.sqrt(x * x + y * y + z * z)
    return vectors / np.maximum(length, 1e-6)[..., None]
