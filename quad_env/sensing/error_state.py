"""Motion of a robot whose feet stand, as its own sensors measure it: its prediction, and that of an error.

Vectors are in the base frame: g the unit vector of gravity, v the velocity of the trunk's centre, p the centre of each
foot from the trunk's centre; ω what the gyroscope says less its bias, f the accelerometer's mean less its bias, G
9.81 m/s². Over a control period dt the base frame turns by ω dt; D = Exp(-ω dt) brings a vector into the new frame:

    g ← D g,    v ← D v + dt (½ (D + 1) f + G g),    p ← D p - ½ dt (D v_before + v) + c × (-r g)

The last term is the roll of a ball-shaped foot of radius r, c being what its calf has turned by. There is no heading
and no place: neither can be observed. The model is that of Bloesch et al., State estimation for legged robots (RSS
2012), and of Hartley et al., Contact-aided invariant extended Kalman filtering (IJRR 2020), seen from the robot, with
gravity alone kept of the attitude.

An error is a vector of `size` entries, at the places `TILT` (a small turn: the true g is Exp(error) g), `VELOCITY`,
`GYRO_BIAS`, `ACCELEROMETER_BIAS` and `foot(i)`: the truth less the estimate.
"""

from typing import NamedTuple

import numpy as np

from quad_env.columns import Array
from quad_env.config import GRAVITY
from quad_env.physics.rotations import skew
from quad_env.robots.robot import Robot
from quad_env.sensing.estimator import unit

TILT, VELOCITY, GYRO_BIAS, ACCELEROMETER_BIAS = (slice(3 * part, 3 * part + 3) for part in range(4))
FEET = slice(ACCELEROMETER_BIAS.stop, None)
IDENTITY = np.eye(3)


class NominalState(NamedTuple):
    """Motion of k robots."""

    gravity: Array
    """Unit vectors, (k, 3)"""
    velocity: Array
    """Of the trunk's centre, m/s, (k, 3)"""
    gyro_bias: Array
    """rad/s, (k, 3)"""
    accelerometer_bias: Array
    """m/s², (k, 3)"""
    feet: Array
    """Centres of the feet from the trunk's centre, m, (k, 4, 3)"""


class StepMeasurements(NamedTuple):
    """Readings of the sensors of k robots in a control period."""

    angular_velocity: Array
    """Mean angular velocity by the gyroscope, rad/s, (k, 3)"""
    force: Array
    """Mean specific force by the accelerometer, m/s², (k, 3)"""
    joints_before: Array
    """Angles at its start, rad, (k, 4, 3)"""
    joints: Array
    """Angles at its end, rad, (k, 4, 3)"""


class RotatedState(NamedTuple):
    """A motion of k robots in the axes of a later moment, and what it is that goes on."""

    turn: Array
    """D of the module's formulas, (k, 3, 3)"""
    force: Array
    """f, m/s², in the axes before, (k, 3)"""
    gravity: Array
    """D g, (k, 3)"""
    velocity: Array
    """D v, m/s, (k, 3)"""
    calves: Array
    """c, rad, (k, 4, 3)"""


def error_dim(robot: Robot) -> int:
    """Entries of an error."""
    return FEET.start + 3 * len(robot.leg_names)


def foot(number: int) -> slice:
    """Place of a foot's position in an error."""
    return slice(FEET.start + 3 * number, FEET.start + 3 * number + 3)


def rotate_state(motion: NominalState, samples: StepMeasurements, dt: float) -> RotatedState:
    """The motion in the axes of a moment `dt`, s, later."""
    angular_velocity = samples.angular_velocity - motion.gyro_bias
    turn = exp_so3(-dt * angular_velocity)
    change, hip = samples.joints - samples.joints_before, 0.5 * (samples.joints + samples.joints_before)[..., 0]
    bend = change[..., 1] + change[..., 2]
    by_joints = np.stack((change[..., 0], bend * np.cos(hip), bend * np.sin(hip)), axis=-1)
    return RotatedState(
        turn,
        samples.force - motion.accelerometer_bias,
        matvec(turn, motion.gravity),
        matvec(turn, motion.velocity),
        dt * angular_velocity[:, None] + by_joints,
    )


def predict(robot: Robot, motion: NominalState, to: RotatedState, dt: float) -> NominalState:
    """The motion one `dt`, s, later."""
    gravity = unit(to.gravity)
    velocity = to.velocity + dt * (matvec(0.5 * (to.turn + IDENTITY), to.force) + GRAVITY * gravity)
    rolled = -robot.foot_radius * np.cross(to.calves, gravity[:, None])
    feet = matvec(to.turn[:, None], motion.feet) - 0.5 * dt * (to.velocity + velocity)[:, None] + rolled
    return motion._replace(gravity=gravity, velocity=velocity, feet=feet)


def error_transition_matrix(
    robot: Robot, motion: NominalState, samples: StepMeasurements, to: RotatedState, dt: float
) -> Array:
    """Derivatives of the error after `predicted` by the error before, (k, size, size)."""
    turn, velocity = to.turn, to.velocity
    down, half = skew(to.gravity), 0.5 * (turn + IDENTITY)
    biased = dt * (IDENTITY - 0.5 * dt * skew(samples.angular_velocity - motion.gyro_bias))
    out = np.zeros((len(turn), error_dim(robot), error_dim(robot)))
    out[:, TILT, TILT] = out[:, VELOCITY, VELOCITY] = turn
    out[:, TILT, GYRO_BIAS] = biased
    out[:, GYRO_BIAS, GYRO_BIAS] = out[:, ACCELEROMETER_BIAS, ACCELEROMETER_BIAS] = IDENTITY
    out[:, VELOCITY, TILT] = -dt * GRAVITY * (down @ turn)
    moved = skew(velocity) + 0.5 * dt * skew(matvec(turn, to.force)) + dt * GRAVITY * down
    out[:, VELOCITY, GYRO_BIAS] = -moved @ biased
    out[:, VELOCITY, ACCELEROMETER_BIAS] = -dt * half
    calves, feet = skew(to.calves), matvec(turn[:, None], motion.feet)
    for leg in range(len(robot.leg_names)):
        here, rolled = foot(leg), robot.foot_radius * (calves[:, leg] @ down)
        out[:, here] = -0.5 * dt * out[:, VELOCITY]
        out[:, here, VELOCITY] -= 0.5 * dt * turn
        out[:, here, TILT] += rolled @ turn
        still = skew(feet[:, leg] - 0.5 * dt * velocity)
        out[:, here, GYRO_BIAS] += (rolled - still) @ biased - robot.foot_radius * dt * down
        out[:, here, here] = turn
    return out


def inject_error(motion: NominalState, error: Array) -> NominalState:
    """The motion that is off from `motion` by an error, (k, size)."""
    return NominalState(
        unit(matvec(exp_so3(error[:, TILT]), motion.gravity)),
        motion.velocity + error[:, VELOCITY],
        motion.gyro_bias + error[:, GYRO_BIAS],
        motion.accelerometer_bias + error[:, ACCELEROMETER_BIAS],
        motion.feet + error[:, FEET].reshape(motion.feet.shape),
    )


def exp_so3(turns: Array) -> Array:
    """Rotation matrices Exp(φ) of turns, rad, (…, 3, 3), by Rodrigues' formula."""
    angle = np.sqrt(np.maximum((turns * turns).sum(axis=-1), 1e-16))[..., None, None]
    axis = skew(turns)
    sines, cosines = np.sin(angle) / angle, 0.5 * (np.sin(0.5 * angle) / (0.5 * angle)) ** 2
    out: Array = IDENTITY + sines * axis + cosines * (axis @ axis)
    return out


def matvec(matrices: Array, vectors: Array) -> Array:
    """Each matrix, (…, 3, 3), times its vector, (…, 3)."""
    out: Array = (matrices @ vectors[..., None])[..., 0]
    return out
