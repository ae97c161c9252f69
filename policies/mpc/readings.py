"""Sensor readings in an observation: their slices, and their prediction by one control period.

The readings are the first 33 numbers of an observation. They form five groups: gravity direction, angular velocity,
linear velocity, joint angles and joint speeds.
"""

import numpy as np

from policies.contact.motion_state import MotionState
from policies.gait_cycle import Floats
from quad_env import OBSERVATION
from quad_env.physics.rotations import cross
from quad_env.robots.robot import Robot
from quad_env.sensing.estimator import unit

GRAVITY = OBSERVATION["projected_gravity"]
ANGULAR_VELOCITY = OBSERVATION["angular_velocity"]
LINEAR_VELOCITY = OBSERVATION["linear_velocity"]
JOINT_POSITION = OBSERVATION["joint_position"]
JOINT_VELOCITY = OBSERVATION["joint_velocity"]

GROUPS = (GRAVITY, ANGULAR_VELOCITY, LINEAR_VELOCITY, JOINT_POSITION, JOINT_VELOCITY)
"""Slices of the five groups of sensor readings in an observation; all readings of a group have one noise variance.

The groups are gravity direction (unit vector), angular velocity, rad/s, linear velocity, m/s, joint angles minus home
pose, rad, and joint speeds, rad/s."""
SENSED = slice(0, JOINT_VELOCITY.stop)
"""Slice of all sensor readings in an observation: its first 33 numbers."""
MAX_READING = np.repeat([1.0, 10.0, 4.0, 3.0, 30.0], [group.stop - group.start for group in GROUPS])
"""Bounds of the absolute values of the 33 predicted sensor readings, (33,), in the order and units of `GROUPS`.

A predicted reading is clipped to its bound, so that a diverging prediction stays finite."""


def predict_readings(robot: Robot, state: MotionState, velocity: Floats, period: float) -> Floats:
    """Predict the sensor readings at the end of a control period.

    The prediction uses the state at the beginning of the period and the generalised velocity at its end. The direction
    of gravity in the base frame, g, changes to g - T ω × g. The trunk velocity is rotated into the new base frame by
    the same formula. The joint angles q change to q + T q̇. Here ω and q̇ are the angular velocity and the joint
    speeds, averaged over the period.

    Args:
        robot: Robot model; it supplies the home pose, which is subtracted from the joint angles.
        state: State of n robots at the beginning of the control period.
        velocity: Generalised velocity at the end of the control period, (n, 18): trunk velocity, level frame (yaw
            only), m/s, angular velocity, base frame, rad/s, and joint speeds, rad/s.
        period: Control period T, s.

    Returns:
        Sensor readings in the order and units of `GROUPS`, (n, 33), clipped to ±`MAX_READING`.
    """
    mean_velocity = 0.5 * (state.generalised_velocity + velocity)
    rotation_vector = period * mean_velocity[:, 3:6]
    down = -state.rotation[:, 2]
    velocity_base = np.matmul(velocity[:, None, :3], state.rotation)[:, 0]
    readings = np.empty((len(velocity), SENSED.stop))
    readings[:, GRAVITY] = down - cross(rotation_vector, down)
    readings[:, LINEAR_VELOCITY] = velocity_base - cross(rotation_vector, velocity_base)
    readings[:, ANGULAR_VELOCITY] = velocity[:, 3:6]
    readings[:, JOINT_VELOCITY] = velocity[:, 6:]
    readings[:, JOINT_POSITION] = state.joint_position - robot.home_pose + period * mean_velocity[:, 6:]
    return normalise_gravity(readings).clip(-MAX_READING, MAX_READING)


def normalise_gravity(readings: Floats) -> Floats:
    """Scale the gravity directions in `readings`, (n, 33), to length 1, in place, and return `readings`."""
    readings[:, GRAVITY] = unit(readings[:, GRAVITY])
    return readings
