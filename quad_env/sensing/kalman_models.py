"""Models of the Kalman filter: motion of a robot in stance with its error dynamics, and contact of the feet.

**Motion**, from the robot's own sensors.
Vectors are in the base frame. g is the unit vector of gravity, v the velocity of the trunk's centre, and p the centre
of each foot relative to the trunk's centre. ω is the gyroscope reading minus its bias, f the mean accelerometer reading
minus its bias, and G 9.81 m/s². Over a control period dt the base frame turns by ω dt; D = Exp(-ω dt) brings a vector
into the new frame:

    g ← D g,    v ← D v + dt (½ (D + 1) f + G g),    p ← D p - ½ dt (D v_before + v) + c × (-r g)

The last term is the rolling of a ball-shaped foot of radius r; c is the rotation of its calf in the period. Heading and
position are no states, because neither can be observed. The model is the one of Bloesch et al., State estimation for
legged robots (RSS 2012), and of Hartley et al., Contact-aided invariant extended Kalman filtering (IJRR 2020), in the
base frame, with gravity as the only part of the attitude.

An error is a vector of `error_dim` entries: the truth minus the estimate. Its parts are `TILT` (a small rotation: the
true g is Exp(error) g), `VELOCITY`, `GYRO_BIAS`, `ACCELEROMETER_BIAS` and `foot(leg)`.

**Contact** of each foot, from its force sensor and from its motion relative to the predicted position.
A hidden Markov model with two states per foot, in contact or not, is updated once per sample. The evidence is the
sensor reading and the innovation ν, the measured minus the predicted position of a foot in contact, with covariance S.
A foot without contact has moved by s more along each axis, where s is `swing_speed` times the sample period:

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
    """Estimated motion of k robots, base frame; the Kalman filter holds one for its whole batch."""

    gravity: Array
    """Unit vector of gravity, (k, 3)."""
    velocity: Array
    """Velocity of the trunk's centre, (k, 3), m/s."""
    gyro_bias: Array
    """Bias of the gyroscope, (k, 3), rad/s."""
    accelerometer_bias: Array
    """Bias of the accelerometer, (k, 3), m/s²."""
    feet: Array
    """Centres of the feet relative to the trunk's centre, (k, 4, 3), m."""


class StepMeasurements(NamedTuple):
    """Sensor readings of k robots over one control period."""

    angular_velocity: Array
    """Mean of the gyroscope at both ends of the period, (k, 3), rad/s."""
    specific_force: Array
    """Mean reading of the accelerometer, (k, 3), m/s²."""
    previous_joints: Array
    """Joint angles at the start of the period, (k, 4, 3), rad."""
    joints: Array
    """Joint angles at its end, (k, 4, 3), rad."""


class RotatedState(NamedTuple):
    """A motion of k robots in the base frame of one control period later, and the inputs of its prediction."""

    rotation: Array
    """D of the module's formulas, from the old base frame to the new one, (k, 3, 3)."""
    specific_force: Array
    """f, old base frame, (k, 3), m/s²."""
    gravity: Array
    """D g, (k, 3)."""
    velocity: Array
    """D v, (k, 3), m/s."""
    calf_rotation: Array
    """c, (k, 4, 3), rad."""


def error_dim(robot: Robot) -> int:
    """Return the number of entries of the robot's error vector."""
    return FEET.start + 3 * len(robot.leg_names)


def foot(leg: int) -> slice:
    """Return the slice of the error vector that holds the foot position of leg number `leg`."""
    return slice(FEET.start + 3 * leg, FEET.start + 3 * leg + 3)


def rotate_state(state: NominalState, measurements: StepMeasurements, dt: float) -> RotatedState:
    """Express a motion in the base frame of one control period later.

    Args:
        state: Motion of k robots at the start of the period.
        measurements: Sensor readings of the period.
        dt: Control period, s.

    Returns:
        The rotated motion, the bias-free specific force and the rotation of the calves.
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
    """Predict the motion one control period later, with all feet at rest on the ground.

    Args:
        robot: Geometry of the robots.
        state: Motion of k robots at the start of the period.
        rotated: The same motion, as `rotate_state` returns it.
        dt: Control period, s.

    Returns:
        The predicted motion; the biases do not change.
    """
    gravity = unit(rotated.gravity)
    acceleration = matvec(0.5 * (rotated.rotation + IDENTITY), rotated.specific_force) + GRAVITY * gravity
    velocity = rotated.velocity + dt * acceleration
    rolling = -robot.foot_radius * np.cross(rotated.calf_rotation, gravity[:, None])
    mean_motion = 0.5 * dt * (rotated.velocity + velocity)
    feet = matvec(rotated.rotation[:, None], state.feet) - mean_motion[:, None] + rolling
    return state._replace(gravity=gravity, velocity=velocity, feet=feet)


def error_transition_matrix(
    robot: Robot, state: NominalState, measurements: StepMeasurements, rotated: RotatedState, dt: float
) -> Array:
    """Compute the derivatives of the error after `predict` with respect to the error before.

    Args:
        robot: Geometry of the robots.
        state: Motion of k robots at the start of the period.
        measurements: Sensor readings of the period.
        rotated: The same motion, as `rotate_state` returns it.
        dt: Control period, s.

    Returns:
        Transition matrices, (k, error_dim, error_dim).
    """
    rotation = rotated.rotation
    gravity_cross = skew(rotated.gravity)
    angular_velocity = measurements.angular_velocity - state.gyro_bias
    bias_to_tilt = dt * (IDENTITY - 0.5 * dt * skew(angular_velocity))
    out = np.zeros((len(rotation), error_dim(robot), error_dim(robot)))
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
    """Fill the foot rows of transition matrices; the velocity rows must be complete."""
    gravity_cross = skew(rotated.gravity)
    calf_cross = skew(rotated.calf_rotation)
    feet = matvec(rotated.rotation[:, None], state.feet)
    for leg in range(len(robot.leg_names)):
        row = foot(leg)
        rolling = robot.foot_radius * (calf_cross[:, leg] @ gravity_cross)
        out[:, row] = -0.5 * dt * out[:, VELOCITY]
        out[:, row, VELOCITY] -= 0.5 * dt * rotated.rotation
        out[:, row, TILT] += rolling @ rotated.rotation
        lever_cross = skew(feet[:, leg] - 0.5 * dt * rotated.velocity)
        out[:, row, GYRO_BIAS] += (rolling - lever_cross) @ bias_to_tilt - robot.foot_radius * dt * gravity_cross
        out[:, row, row] = rotated.rotation


def inject_error(state: NominalState, error: Array) -> NominalState:
    """Return the motion that differs from `state` by `error`, (k, error_dim)."""
    return NominalState(
        unit(matvec(exp_so3(error[:, TILT]), state.gravity)),
        state.velocity + error[:, VELOCITY],
        state.gyro_bias + error[:, GYRO_BIAS],
        state.accelerometer_bias + error[:, ACCELEROMETER_BIAS],
        state.feet + error[:, FEET].reshape(state.feet.shape),
    )


def exp_so3(rotation_vectors: Array) -> Array:
    """Return the matrices Exp(φ), (…, 3, 3), of `rotation_vectors` φ, (…, 3), rad (Rodrigues)."""
    angle = np.sqrt(np.maximum((rotation_vectors * rotation_vectors).sum(axis=-1), 1e-16))[..., None, None]
    axis = skew(rotation_vectors)
    sine_term = np.sin(angle) / angle
    cosine_term = 0.5 * (np.sin(0.5 * angle) / (0.5 * angle)) ** 2
    out: Array = IDENTITY + sine_term * axis + cosine_term * (axis @ axis)
    return out


def matvec(matrices: Array, vectors: Array) -> Array:
    """Multiply each of the `matrices`, (…, 3, 3), with its entry of `vectors`, (…, 3)."""
    out: Array = (matrices @ vectors[..., None])[..., 0]
    return out


@dataclass(frozen=True)
class ContactParameters:
    """Parameters of the hidden Markov model of contact, found on search episodes of `trot` and `trot_feedback`."""

    liftoff_probability: float = 0.3
    """Probability that a foot in contact has lost it one sample later; a larger value drops contacts sooner."""
    touchdown_probability: float = 0.0015
    """Probability that a foot without contact has it one sample later; small, so that only a foot at rest counts."""
    true_positive_rate: float = 0.95
    """Fraction of the samples of feet in contact in which the force sensor reads contact."""
    false_positive_rate: float = 0.17
    """Fraction of the samples of other feet in which it reads contact; these include feet moving at touchdown."""
    swing_speed: float = 1.2
    """m/s. Std of a foot's speed along each axis without contact; a larger value needs more motion to end a contact."""
    max_log_odds: float = 12.0
    """Limit of the logarithm of the odds in both directions, so that no state becomes certain."""


CONTACT_PARAMETERS = ContactParameters()


def contact_probability(previous: Array, contact: Mask, innovation: Array, covariance: Array, dt: float) -> Array:
    """Update the contact probability of each foot by one sample of the hidden Markov model.

    Args:
        previous: Contact probability one sample ago, (k, 4).
        contact: Readings of the force sensors, (k, 4) bool.
        innovation: ν, measured minus predicted foot position, base frame, (k, 4, 3), m.
        covariance: S, of the innovation of a foot in contact, (k, 4, 3, 3), m².
        dt: Sample period, s.

    Returns:
        Contact probability, (k, 4).
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
    """Return the logarithm of the normal density up to a constant, (…)."""
    distance = (vectors[..., None, :] @ np.linalg.solve(covariances, vectors[..., None]))[..., 0, 0]
    out: Array = -0.5 * (distance + np.log(np.linalg.det(covariances)))
    return out
