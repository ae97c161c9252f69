"""Readings of a robot: their groups in the observation, and their prediction over a control period."""

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
"""Slices of the groups of readings; a group has one noise variance. Unit vector, rad/s, m/s, rad, rad/s."""
SENSED = slice(0, JOINT_VELOCITY.stop)
"""Slice of the readings in an observation: its first 33 entries."""
MAX_READING = np.repeat([1.0, 10.0, 4.0, 3.0, 30.0], [group.stop - group.start for group in GROUPS])
"""Largest absolute values of predicted readings, (33,); keeps a diverging prediction bounded."""


def predict_readings(robot: Robot, state: MotionState, velocity: Floats, period: float) -> Floats:
    """Predict the readings one control period later.

    Bars mark means of the values before and after the period, and g is the direction of gravity in the base frame:
    g⁺ = g - T ω̄ × g, the same for the velocity of the trunk, and q⁺ = q + T q̄̇ for the joint angles.

    Args:
        robot: Robot of the readings.
        state: State of n robots before the period.
        velocity: Generalised velocity after the period, (n, 18), m/s and rad/s.
        period: Control period T, s.

    Returns:
        Readings, (n, 33), clipped to ±`MAX_READING`.
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
    """Scale the direction of gravity in `readings`, (n, k), to length one, in place; return the readings."""
    readings[:, GRAVITY] = unit(readings[:, GRAVITY])
    return readings
