"""Attitude, velocity, biases and feet of n robots by an error-state Kalman filter whose standing feet rest.

The motion and the derivatives of its error are those of `error_state`; the encoders measure where the feet are. What is
noise follows from what is known of the sensors, their `SensorSuite`, but for the figures below, which were found on
search episodes of `trot` and `trot_feedback`, flat, rough and straight on. Of errors that do not change within an
episode only the biases of the IMU are states; its place, its mounting and the encoders' zeros are counted in the noise.

A foot that probably does not stand is given a large noise of its own, most of all along the ground, one that has just
touched down or is pressed otherwise than before a smaller one, and one that is farther from where it was than its
covariance explains, as a foot that slides, as much as explains it.
"""

from typing import NamedTuple

import numpy as np

from quad_env.columns import Array, EnvIndices
from quad_env.config import GRAVITY
from quad_env.physics.rotations import skew
from quad_env.robots.kinematics import foot_jacobians, foot_positions
from quad_env.robots.robot import Robot
from quad_env.sensing import error_state
from quad_env.sensing.contact_probability import SWING_SPEED, contact_probability
from quad_env.sensing.error_state import (
    ACCELEROMETER_BIAS,
    FEET,
    GYRO_BIAS,
    IDENTITY,
    TILT,
    VELOCITY,
    NominalState,
    StepMeasurements,
    exp_so3,
    matvec,
)
from quad_env.sensing.estimator import AlignedReadings, unit
from quad_env.sensing.suite import SensorSuite

GYRO_INTERPOLATION_NOISE = 0.35
"""Share of the change from one sample of the gyroscope to the next by which their mean is not that of the time between
them."""
ACCELEROMETER_SCALE_NOISE = 0.01
"""Share of the acceleration by which the accelerometer's axes and the mean of the turning trunk's leave it unknown."""
LEVER_ARM_NOISE_GAIN = 0.5
"""Share of the IMU's distance from the trunk's centre that counts as noise at each sample; the velocity that the
turning trunk gives it comes and goes with every stride."""
CONTACT_VELOCITY_STD = 0.015
"""m/s, standard deviation of the speed of a standing foot along each axis."""
ENCODER_OFFSET_NOISE_GAIN = 8.0
"""Factor on the noise by the encoders' zeros, which is nearly the same from sample to sample of a stance."""
TOUCHDOWN_VELOCITY_STD, TOUCHDOWN_NOISE_DECAY = 1.2, 0.013
"""m/s along the vertical, standard deviation of the speed of a foot that has just touched down, and s in which it falls
to 1/e: soft ground gives way and comes back."""
GROUND_COMPLIANCE = 2e-4
"""s², what the ground gives along the vertical per change of the specific force on the trunk, and takes back when it
goes: a foot that is pressed by several weights at once sinks and comes up again, and does so in every stance."""
SWING_HORIZONTAL_VELOCITY_STD = 30.0
"""m/s, standard deviation of the speed along the ground of a foot that does not stand; so large that swing feet, which
move forward on average and fast after a push, do not pull the velocity. Along the vertical it is `SWING_SPEED`: what
rises comes down again, which keeps the vertical velocity where the ground lifts the standing feet."""
SLIP_INNOVATION_GAIN = 4.0
"""Factor on what a standing foot's distance from where it was is beyond its covariance, as a variance."""
ACCELEROMETER_BIAS_RANDOM_WALK = 0.014
"""m/s² in √s that the accelerometer's bias may change, since what is left unsaid above looks like one that does."""
SLIP_VELOCITY_INFLATION = 0.05
"""Share of the speed of a foot that moves, though its sensor has long said that it stands, by which the velocity is
doubted at each sample: what slides may be the estimate."""
MIN_CONTACT_DURATION = 0.025
"""s of an uninterrupted reading that are long."""
INITIAL_VELOCITY_STD = 0.2
"""m/s, standard deviation of the velocity along each axis at the start."""
ACCELERATION_EXTRAPOLATION_GAIN = 0.8
"""Share of the last change of the acceleration that goes on until now, as seen from the moment of the readings."""
MISSING_SAMPLE_STD = 1e3
"""rad, standard deviation of angles of which there is no new sample."""


class SensorErrors(NamedTuple):
    """Standard deviations of what is known of the sensors' errors; none is nothing, so that covariances are regular."""

    gyro: float
    """rad/s"""
    gyro_bias: float
    """rad/s"""
    accelerometer: float
    """m/s²"""
    accelerometer_bias: float
    """m/s²"""
    angle: float
    """Of an encoder's sample, noise and rounding, rad"""
    zero: float
    """Of an encoder's zero, rad"""
    lever: float
    """Of the IMU's place along each axis, m"""
    mounting: float
    """Of the IMU's axes about each axis, rad"""


def sensor_errors(suite: SensorSuite) -> SensorErrors:
    """What a data sheet says of these sensors; of place and mounting of the IMU only the size is taken."""
    imu, encoders = suite.imu, suite.encoders
    return SensorErrors(
        gyro=max(imu.gyro_noise, 1e-4),
        gyro_bias=max(imu.gyro_bias, 1e-5),
        accelerometer=max(imu.accelerometer_noise, 1e-3),
        accelerometer_bias=max(imu.accelerometer_bias, 1e-3),
        angle=max(float(np.hypot(encoders.noise, encoders.step / np.sqrt(12.0))), 1e-4),
        zero=encoders.zero_offset,
        lever=float(np.sqrt(np.mean(np.square(imu.position)))),
        mounting=float(np.sqrt(np.mean(np.square(imu.rotation)))),
    )


class KalmanFilter:
    """Estimates of n robots, base frame, moved on by `dt`, s, at a time; readings are `late` control steps old."""

    def __init__(self, robot: Robot, suite: SensorSuite, num_envs: int, dt: float, delay_steps: int) -> None:
        legs = len(robot.leg_names)
        self._robot, self._dt, self._late, self._errors = robot, dt, delay_steps, sensor_errors(suite)
        self.gravity, self.velocity, self.gyro_bias = (np.zeros((num_envs, 3)) for _ in range(3))
        """Of now: unit vectors, and velocity of the trunk's centre, m/s; bias of the gyroscope, rad/s"""
        shapes = [(num_envs, 3)] * 4 + [(num_envs, legs, 3)]
        self.motion = NominalState._make(map(np.zeros, shapes))
        """Of the moment of the readings"""
        self._covariance = np.zeros((num_envs, error_state.error_dim(robot), error_state.error_dim(robot)))
        self.standing = np.zeros((num_envs, legs))
        """Probability that each foot stands, (n, 4)"""
        self._rest = np.zeros((num_envs, legs))
        """s that each foot has stood"""
        self._read = np.zeros((num_envs, legs))
        """s that its sensor has said so"""
        self._gyro, self._joints = np.zeros((num_envs, 3)), np.zeros((num_envs, legs, 3))
        self._acceleration = np.zeros((num_envs, 3))
        self._force = np.zeros((num_envs, 3))
        self._jacobians = np.zeros((num_envs, legs, 3, 3))
        """Of the feet by `_joints`, m/rad"""

    @property
    def covariance(self) -> Array:
        """Of the error of `motion`, the IMU's mounting with it; (n, 24, 24), in the order of `error_state`."""
        out = self._covariance.copy()
        out[:, TILT, TILT] += self._errors.mounting**2 * IDENTITY
        return out

    def reset(self, rows: EnvIndices, at_rest: Array, read: AlignedReadings) -> None:
        """Start of those robots, whose accelerometers read so before, (k, 3), when they stood still."""
        errors, joints = self._errors, read.joints.reshape(-1, *self._joints.shape[1:])
        gravity, still = -unit(at_rest), np.zeros_like(at_rest)
        feet = self._robot.hip_positions + foot_positions(self._robot, joints)
        self._keep(rows, NominalState(gravity, still, still, still, feet))
        # A bias of the accelerometer is a tilt of what it reads at rest.
        tilt, bias = skew(gravity) / GRAVITY, errors.accelerometer_bias**2 * IDENTITY
        covariance = np.zeros((len(rows), *self._covariance.shape[1:]))
        covariance[:, TILT, TILT] = tilt @ bias @ tilt.mT + 1e-6 * IDENTITY
        covariance[:, TILT, ACCELEROMETER_BIAS] = tilt @ bias
        covariance[:, ACCELEROMETER_BIAS, TILT] = (tilt @ bias).mT
        covariance[:, ACCELEROMETER_BIAS, ACCELEROMETER_BIAS] = bias
        covariance[:, VELOCITY, VELOCITY] = INITIAL_VELOCITY_STD**2 * IDENTITY
        covariance[:, GYRO_BIAS, GYRO_BIAS] = errors.gyro_bias**2 * IDENTITY
        covariance[:, FEET, FEET] = 1e-4 * np.eye(feet[0].size)
        self._covariance[rows], self.standing[rows] = covariance, 0.5 * read.contact
        self._rest[rows] = self._read[rows] = 0.0
        self._gyro[rows], self._joints[rows], self._acceleration[rows] = read.gyro, joints, 0.0
        self._jacobians[rows], self._force[rows] = foot_jacobians(self._robot, joints), at_rest
        self.gravity[rows], self.velocity[rows], self.gyro_bias[rows] = gravity, 0.0, 0.0

    def update(self, read: AlignedReadings, rows: EnvIndices) -> None:
        """One `dt` later those robots' sensors read this."""
        before = NominalState._make(values[rows] for values in self.motion)
        joints = read.joints.reshape(-1, *self._joints.shape[1:])
        samples = StepMeasurements(0.5 * (self._gyro[rows] + read.gyro), read.accelerometer, self._joints[rows], joints)
        to = error_state.rotate_state(before, samples, self._dt)
        motion = error_state.predict(self._robot, before, to, self._dt)
        acceleration = matvec(0.5 * (to.turn + IDENTITY), to.force) + GRAVITY * motion.gravity
        transition_matrix = error_state.error_transition_matrix(self._robot, before, samples, to, self._dt)
        covariance = self._predicted_covariance(rows, transition_matrix, read.gyro - self._gyro[rows], acceleration)
        force_change = np.sqrt(_squared(to.force - self._force[rows]))[..., None]
        self._force[rows] = to.force
        error, self._covariance[rows] = self._measurement_update(rows, read, motion, samples, force_change, covariance)
        motion = error_state.inject_error(motion, error)
        self._keep(rows, motion)
        self._extrapolate_to_now(rows, motion, read.gyro, acceleration, matvec(to.turn, self._acceleration[rows]))
        self._gyro[rows], self._joints[rows], self._acceleration[rows] = read.gyro, joints, acceleration

    def _predicted_covariance(
        self, rows: EnvIndices, transition_matrix: Array, change: Array, acceleration: Array
    ) -> Array:
        """Before the feet are looked at; `onward` is the transition of the error, `change` that of the angular velocity
        in this period, rad/s."""
        errors, dt = self._errors, self._dt
        out: Array = transition_matrix @ self._covariance[rows] @ transition_matrix.mT
        by_turning, by_force = (
            transition_matrix[:, :, GYRO_BIAS].copy(),
            transition_matrix[:, :, ACCELEROMETER_BIAS].copy(),
        )
        by_turning[:, GYRO_BIAS] = by_force[:, ACCELEROMETER_BIAS] = 0.0
        turning = errors.gyro**2 + GYRO_INTERPOLATION_NOISE**2 / 3 * _squared(change)
        pushed, lever = errors.accelerometer**2 + ACCELEROMETER_SCALE_NOISE**2 * _squared(acceleration), skew(change)
        lever_arm_covariance = (LEVER_ARM_NOISE_GAIN * errors.lever / dt) ** 2 * (lever @ lever.mT)
        out += by_turning @ (turning * by_turning.mT)
        out += by_force @ (pushed * IDENTITY + lever_arm_covariance) @ by_force.mT
        out[:, ACCELEROMETER_BIAS, ACCELEROMETER_BIAS] += ACCELEROMETER_BIAS_RANDOM_WALK**2 * dt * IDENTITY
        return out

    def _measurement_update(
        self,
        rows: EnvIndices,
        read: AlignedReadings,
        motion: NominalState,
        samples: StepMeasurements,
        force_change: Array,
        covariance: Array,
    ) -> tuple[Array, Array]:
        """The error that the encoders show, (k, 24), and the covariance after them; `loaded` is what the specific force
        has changed by, m/s², (k, 1, 1, 1)."""
        errors, dt, robot = self._errors, self._dt, self._robot
        jacobians = foot_jacobians(robot, samples.joints)
        change = jacobians - self._jacobians[rows]
        self._jacobians[rows] = jacobians
        down = motion.gravity[:, None, :, None] * motion.gravity[:, None, None, :]
        landing = (TOUCHDOWN_VELOCITY_STD * np.exp(-self._rest[rows] / TOUCHDOWN_NOISE_DECAY))[..., None, None]
        offset = (ENCODER_OFFSET_NOISE_GAIN * errors.zero) ** 2 * (change @ change.mT)
        sinking = (dt * landing) ** 2 + (GROUND_COMPLIANCE * force_change) ** 2
        moved = (dt * CONTACT_VELOCITY_STD) ** 2 * IDENTITY + sinking * down + offset
        angles = np.where(read.fresh, errors.angle, MISSING_SAMPLE_STD)[:, None, None, None]
        noise = angles * angles * (jacobians @ jacobians.mT)
        innovation = robot.hip_positions + foot_positions(robot, samples.joints) - motion.feet
        expected = _blocks(covariance, len(robot.leg_names)) + moved + noise
        standing = contact_probability(self.standing[rows], read.contact, innovation, expected, dt)
        self.standing[rows] = standing
        self._rest[rows] = standing * (self._rest[rows] + dt)
        self._read[rows] = read.contact * (self._read[rows] + dt)
        doubted = np.where(self._read[rows] > MIN_CONTACT_DURATION, 1.0 - standing, 0.0) * (
            innovation * innovation
        ).sum(axis=-1)
        covariance[:, VELOCITY, VELOCITY] += (
            (SLIP_VELOCITY_INFLATION / dt) ** 2 * doubted.sum(axis=-1)[:, None, None] * IDENTITY
        )
        _add(covariance, moved + _swing_covariance(standing, innovation, expected, down, dt))
        seen = covariance[:, FEET, FEET].copy()
        _add(seen, noise, 0)
        gain = np.linalg.solve(seen, covariance[:, FEET])
        error = (innovation.reshape(len(rows), 1, -1) @ gain)[:, 0]
        out = covariance - covariance[:, FEET].mT @ gain
        return error, 0.5 * (out + out.mT)

    def _extrapolate_to_now(
        self, rows: EnvIndices, motion: NominalState, gyro: Array, acceleration: Array, earlier: Array
    ) -> None:
        """Go on from the moment of the readings to now, the trunk turning as it does and pushed as it is."""
        turn = exp_so3(-self._late * self._dt * (gyro - motion.gyro_bias))
        gained = self._late * self._dt * (acceleration + ACCELERATION_EXTRAPOLATION_GAIN * (acceleration - earlier))
        self.gravity[rows] = unit(matvec(turn, motion.gravity))
        self.velocity[rows] = matvec(turn, motion.velocity + gained)
        self.gyro_bias[rows] = motion.gyro_bias

    def _keep(self, rows: EnvIndices, motion: NominalState) -> None:
        for kept, values in zip(self.motion, motion, strict=True):
            kept[rows] = values


def _swing_covariance(standing: Array, innovation: Array, expected: Array, down: Array, dt: float) -> Array:
    """Covariance of what a foot moves by beyond one that surely stands, m², (k, 4, 3, 3)."""
    rest = (CONTACT_VELOCITY_STD * dt) ** 2
    level, vertical = (
        rest * ((speed / CONTACT_VELOCITY_STD) ** (2 - 2 * standing) - 1)
        for speed in (SWING_HORIZONTAL_VELOCITY_STD, SWING_SPEED)
    )
    beyond = (innovation * innovation).sum(axis=-1) - (expected * IDENTITY).sum(axis=(-2, -1))
    sliding = level + SLIP_INNOVATION_GAIN / 3 * standing * np.maximum(beyond, 0.0)
    out: Array = sliding[..., None, None] * IDENTITY + (vertical - level)[..., None, None] * down
    return out


def _blocks(covariance: Array, legs: int) -> Array:
    """Covariance of each foot's own place, (k, 4, 3, 3)."""
    return np.stack([covariance[:, error_state.foot(leg), error_state.foot(leg)] for leg in range(legs)], axis=1)


def _add(matrices: Array, blocks: Array, start: int = FEET.start) -> None:
    """Add blocks, (k, 4, 3, 3), along the diagonal of matrices from that place on."""
    for leg in range(blocks.shape[1]):
        place = slice(start + 3 * leg, start + 3 * leg + 3)
        matrices[:, place, place] += blocks[:, leg]


def _squared(vectors: Array) -> Array:
    """Squared lengths, (k, 1, 1)."""
    out: Array = (vectors * vectors).sum(axis=-1)[:, None, None]
    return out
