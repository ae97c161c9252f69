"""Models of the Kalman filter: process model of the robot's motion, and contact model of the feet.

**Process model.** It predicts the motion from the robot's own sensors.
Vectors are in the base frame. g is the unit vector of gravity, and v the velocity of the trunk's centre. p is the
centre of each foot relative to the trunk's centre. ω is the gyroscope reading minus the gyroscope bias. f is the mean
accelerometer reading minus the accelerometer bias, and G is 9.81 m/s². The base frame turns by ω dt over a control
period dt. The rotation matrix D = Exp(-ω dt) transforms a vector from the base frame at the start of the period to the
base frame at its end. v_before is v before the update, and 1 the identity matrix:

    g ← D g,    v ← D v + dt (½ (D + 1) f + G g),    p ← D p - ½ dt (D v_before + v) + c × (-r g)

The last term is the rolling of a ball-shaped foot of radius r, where c is the rotation of the foot's calf during the
period. Heading and position are not states, because the sensors cannot observe them. The model follows Bloesch et al.,
State estimation for legged robots (RSS 2012), and Hartley et al., Contact-aided invariant extended Kalman filtering
(IJRR 2020). Here the states are in the base frame, and gravity is the only part of the attitude.

The error of the state, true value minus estimate, is a vector of `error_dim` components. Its slices are `TILT` (a small
rotation: the true g is Exp(error) g), `VELOCITY`, `GYRO_BIAS`, `ACCELEROMETER_BIAS` and `foot(leg)`.

**Contact model.** It computes the contact probability of each foot from the force sensor and from the foot's motion.
A hidden Markov model with two states per foot, in contact or not, is updated once per sample. The evidence is the
sensor reading and the innovation ν: the measured foot position minus the position predicted for a foot in contact. The
innovation of a foot in contact has the covariance S. The innovation of a foot without contact has an extra standard
deviation s along each axis, where s is `swing_speed` times the sample period. N is the normal density, and the odds are
the probability of contact divided by the probability of no contact:

    odds ← prior odds · P(reading | contact)/P(reading | no contact) · N(ν; 0, S)/N(ν; 0, S + s² 1)
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from quad_env.columns import Array, Mask
from quad_env.config import GRAVITY
from quad_env.physics.rotations import skew
from quad_env.robots.robot import Robot
from quad_env.sensing.estimator import unit

TILT = slice(0, 3)
VELOCITY = slice(3, 6)
GYRO_BIAS = slice(6, 9)
ACCELEROMETER_BIAS = slice(9, 9 + 3)
FEET = slice(ACCELEROMETER_BIAS.stop, None)
IDENTITY = np.eye(3)


class NominalState(NamedTuple):
    """State of k robots that the Kalman filter estimates, base frame."""

    gravity: Array
    """Unit vector of gravity for each of k robots, base frame, (k, 3)."""
    velocity: Array
    """Velocity of the trunk's centre of each of k robots, base frame, (k, 3), m/s."""
    gyro_bias: Array
    """Bias of the gyroscope of each of k robots, base frame, (k, 3), rad/s."""
    accelerometer_bias: Array
    """Bias of the accelerometer of each of k robots, base frame, (k, 3), m/s²."""
    feet: Array
    """Centres of the feet of k robots relative to the trunk's centre, base frame, (k, 4, 3), m."""


class StepMeasurements(NamedTuple):
    """Sensor readings of k robots over one control period, which are the inputs of the process model."""

    angular_velocity: Array
    """Mean of the gyroscope readings at the period's start and end, for k robots, base frame, (k, 3), rad/s."""
    specific_force: Array
    """Mean accelerometer reading of k robots over the control period, base frame, (k, 3), m/s²."""
    previous_joints: Array
    """Hip, thigh and calf angle of each leg of k robots at the start of the control period, (k, 4, 3), rad."""
    joints: Array
    """Hip, thigh and calf angle of each leg of k robots at the end of the control period, (k, 4, 3), rad."""


class RotatedState(NamedTuple):
    """State of k robots at the start of a control period, rotated to the base frame at its end.

    In the formulas of the module docstring, `rotation` is D, `specific_force` is f, `gravity` is D g, `velocity` is D
    v, and `calf_rotation` is c.
    """

    rotation: Array
    """Rotation matrices from the base frame before a control period to the base frame after it, (k, 3, 3).

    Each of k robots has one matrix.
    """
    specific_force: Array
    """Mean accelerometer reading of k robots minus the estimated accelerometer bias, (k, 3), m/s².

    The vector is in the base frame at the start of the control period. The other vectors of this class are in the base
    frame at its end.
    """
    gravity: Array
    """Unit vector of gravity for each of k robots, base frame at the end of the control period, (k, 3)."""
    velocity: Array
    """Velocity of the trunk's centre at the start of the control period, for k robots, (k, 3), m/s.

    The vector is expressed in the base frame at the end of the period.
    """
    calf_rotation: Array
    """Rotation vector of each calf of k robots during the control period, base frame, (k, 4, 3), rad."""


def error_dim(robot: Robot) -> int:
    """Return the length of the error vector of the estimated state: 12 plus 3 per leg of the `robot`."""
    return FEET.start + 3 * len(robot.leg_names)


def foot(leg: int) -> slice:
    """Return the slice of the state's error vector with the foot position error of the leg number `leg`."""
    return slice(FEET.start + 3 * leg, FEET.start + 3 * leg + 3)


def rotate_state(state: NominalState, measurements: StepMeasurements, dt: float) -> RotatedState:
    """Rotate the state at the start of a control period to the base frame at the end of the period.

    Args:
        state: State of k robots at the start of the period.
        measurements: Sensor readings of the period.
        dt: Control period, s.

    Returns:
        Rotated gravity and velocity, the rotation matrix, the specific force minus its bias, and the calf rotations.
    """
    angular_velocity = measurements.angular_velocity - state.gyro_bias
    rotation = exp_so3(-dt * angular_velocity)
    joint_change = measurements.joints - measurements.previous_joints
    hip = 0.5 * (measurements.joints + measurements.previous_joints)[..., 0]
    bend = joint_change[..., 1] + joint_change[..., 2]
    joint_rotation = np.stack((joint_change[..., 0], bend * np.cos(hip), bend * np.sin(hip)), axis=-1)
    return RotatedState(
        rotation,
        measurements.specific_force - state.accelerometer_bias,
        matvec(rotation, state.gravity),
        matvec(rotation, state.velocity),
        dt * angular_velocity[:, None] + joint_rotation,
    )


def predict(robot: Robot, state: NominalState, rotated: RotatedState, dt: float) -> NominalState:
    """Predict the state one control period later, under the assumption that all feet are in contact.

    Args:
        robot: Geometry of the robots.
        state: State of k robots at the start of the period.
        rotated: Result of `rotate_state` for `state`.
        dt: Control period, s.

    Returns:
        State of the k robots at the end of the period; the biases do not change.
    """
    gravity = unit(rotated.gravity)
    acceleration = matvec(0.5 * (rotated.rotation + IDENTITY), rotated.specific_force) + GRAVITY * gravity
    velocity = rotated.velocity + dt * acceleration
    rolling = -robot.foot_radius * np.cross(rotated.calf_rotation, gravity[:, None])
    mean_motion = 0.5 * dt * (rotated.velocity + velocity)
    feet = matvec(rotated.rotation[:, None], state.feet) - mean_motion[:, None] + rolling
    return state._replace(gravity=gravity, velocity=velocity, feet=feet)


def error_transition_matrix(
    robot: Robot,
    state: NominalState,
    measurements: StepMeasurements,
    rotated: RotatedState,
    dt: float,
    out: Array | None = None,
) -> Array:
    """Compute the derivative of the state's error after `predict` with respect to the error before it.

    Args:
        robot: Geometry of the robots.
        state: State of k robots at the start of the period.
        measurements: Sensor readings of the period.
        rotated: Result of `rotate_state` for `state`.
        dt: Control period, s.
        out: Array to which the result is written; None for a new array.

    Returns:
        Transition matrices of the k error vectors, (k, error_dim, error_dim), see `error_dim`.
    """
    rotation = rotated.rotation
    gravity_cross = skew(rotated.gravity)
    angular_velocity = measurements.angular_velocity - state.gyro_bias
    bias_to_tilt = dt * (IDENTITY - 0.5 * dt * skew(angular_velocity))
    if out is None:
        out = np.empty((len(rotation), error_dim(robot), error_dim(robot)))
    out.fill(0.0)
    out[:, TILT, TILT] = rotation
    out[:, TILT, GYRO_BIAS] = bias_to_tilt
    out[:, VELOCITY, VELOCITY] = rotation
    out[:, VELOCITY, TILT] = -dt * GRAVITY * (gravity_cross @ rotation)
    force_cross = skew(matvec(rotation, rotated.specific_force))
    velocity_cross = skew(rotated.velocity) + 0.5 * dt * force_cross + dt * GRAVITY * gravity_cross
    out[:, VELOCITY, GYRO_BIAS] = -velocity_cross @ bias_to_tilt
    out[:, VELOCITY, ACCELEROMETER_BIAS] = -dt * (0.5 * (rotation + IDENTITY))
    out[:, GYRO_BIAS, GYRO_BIAS] = IDENTITY
    out[:, ACCELEROMETER_BIAS, ACCELEROMETER_BIAS] = IDENTITY
    _fill_foot_rows(out, robot, state, rotated, bias_to_tilt, dt)
    return out


def _fill_foot_rows(
    out: Array, robot: Robot, state: NominalState, rotated: RotatedState, bias_to_tilt: Array, dt: float
) -> None:
    """Fill the rows of the foot position errors in the matrices `out`, (k, error_dim, error_dim).

    `out` are the transition matrices of k robots, with filled velocity rows. `state` is the state at the start of the
    control period, `rotated` the result of `rotate_state` for it, and `dt` the control period, s. `bias_to_tilt` is the
    derivative of the tilt error with respect to the error of the gyroscope bias, (k, 3, 3), s.
    """
    gravity_cross = skew(rotated.gravity)[:, None]
    rotation = rotated.rotation[:, None]
    rows = out[:, FEET].reshape(len(out), len(robot.leg_names), 3, -1)  # a view, one item of axis 1 for each foot
    rolling = robot.foot_radius * (skew(rotated.calf_rotation) @ gravity_cross)
    feet = matvec(rotation, state.feet)
    lever_cross = skew(feet - 0.5 * dt * rotated.velocity[:, None])
    rows[:] = (-0.5 * dt * out[:, VELOCITY])[:, None]
    rows[..., VELOCITY] -= 0.5 * dt * rotation
    rows[..., TILT] += rolling @ rotation
    gyro_gain = (rolling - lever_cross) @ bias_to_tilt[:, None]
    rows[..., GYRO_BIAS] += gyro_gain - robot.foot_radius * dt * gravity_cross
    for leg in range(len(robot.leg_names)):
        rows[:, leg, :, foot(leg)] = rotated.rotation


def inject_error(state: NominalState, error: Array) -> NominalState:
    """Return the `state` of k robots after the correction by its estimated `error`, (k, error_dim)."""
    return NominalState(
        unit(matvec(exp_so3(error[:, TILT]), state.gravity)),
        state.velocity + error[:, VELOCITY],
        state.gyro_bias + error[:, GYRO_BIAS],
        state.accelerometer_bias + error[:, ACCELEROMETER_BIAS],
        state.feet + error[:, FEET].reshape(state.feet.shape),
    )


def exp_so3(rotation_vectors: Array) -> Array:
    """Convert `rotation_vectors` φ, (…, 3), rad, to rotation matrices Exp(φ), (…, 3, 3) (Rodrigues)."""
    angle = np.sqrt(np.maximum((rotation_vectors * rotation_vectors).sum(axis=-1), 1e-16))[..., None, None]
    axis = skew(rotation_vectors)
    sine_term = np.sin(angle) / angle
    cosine_term = 0.5 * (np.sin(0.5 * angle) / (0.5 * angle)) ** 2
    out: Array = IDENTITY + sine_term * axis + cosine_term * (axis @ axis)
    return out


def matvec(matrices: Array, vectors: Array) -> Array:
    """Return the product of each of the `matrices`, (…, 3, 3), and the vector in `vectors`, (…, 3)."""
    out: Array = (matrices @ vectors[..., None])[..., 0]
    return out


@dataclass(frozen=True)
class ContactParameters:
    """Parameters of the hidden Markov model that estimates the contact of each foot.

    All values were tuned on episodes that are reserved for searches, with the policies `trot` and `trot_feedback`.
    """

    liftoff_probability: float = 0.3
    """Probability that a foot in contact is no longer in contact one sample later.

    A larger value makes the model drop contacts sooner.
    """
    touchdown_probability: float = 0.0015
    """Probability that a foot without contact is in contact one sample later.

    The value is small, so that the model accepts a contact only if the foot does not move.
    """
    true_positive_rate: float = 0.95
    """Probability that the force sensor reads contact, if the foot is in contact."""
    false_positive_rate: float = 0.17
    """Probability that the force sensor reads contact, if the model considers the foot not in contact.

    The model considers a foot that touches the ground but still moves not in contact.
    """
    swing_speed: float = 1.2
    """Standard deviation of the velocity of a foot without contact, along each axis, m/s.

    A larger value makes the model require more motion to end a contact.
    """
    max_log_odds: float = 12.0
    """Largest magnitude of the logarithm of the contact odds, so that the model never becomes certain."""


CONTACT_PARAMETERS = ContactParameters()


def contact_probability(previous: Array, contact: Mask, innovation: Array, covariance: Array, dt: float) -> Array:
    """Update the contact probability of each foot by one sample of the hidden Markov model.

    Args:
        previous: Contact probability of each foot of k robots one sample ago, (k, 4).
        contact: Readings of the force sensors, (k, 4) bool; True for contact.
        innovation: Measured minus predicted foot position, base frame, (k, 4, 3), m.
        covariance: Covariance of the innovation of a foot in contact, base frame, (k, 4, 3, 3), m².
        dt: Sample period, s.

    Returns:
        Contact probability after this sample, (k, 4).
    """
    model = CONTACT_PARAMETERS
    prior = previous * (1.0 - model.liftoff_probability) + (1.0 - previous) * model.touchdown_probability
    reading_log_odds = np.where(
        contact,
        np.log(model.true_positive_rate / model.false_positive_rate),
        np.log((1.0 - model.true_positive_rate) / (1.0 - model.false_positive_rate)),
    )
    swing_covariance = covariance + (model.swing_speed * dt) ** 2 * np.eye(3)
    motion_log_odds = _log_density(innovation, covariance) - _log_density(innovation, swing_covariance)
    log_odds = np.log(prior / (1.0 - prior)) + reading_log_odds + motion_log_odds
    out: Array = 1.0 / (1.0 + np.exp(-np.clip(log_odds, -model.max_log_odds, model.max_log_odds)))
    return out


def _log_density(vectors: Array, covariances: Array) -> Array:
    """Return the logarithm of zero-mean normal densities without its constant term, (…).

    The density is evaluated at `vectors`, (…, 3), with the covariance matrices `covariances`, (…, 3, 3). The constant
    term, -1.5 log(2π), cancels in a ratio of densities.
    """
    distance = (vectors[..., None, :] @ np.linalg.solve(covariances, vectors[..., None]))[..., 0, 0]
    out: Array = -0.5 * (distance + np.log(np.linalg.det(covariances)))
    return out
