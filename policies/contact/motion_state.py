"""Computation of the motion state of n robots, and of their dynamics terms, from the observations."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.legs.level_frame import level_frame
from quad_env import OBSERVATION
from quad_env.physics.dynamics import Dynamics, DynamicsTerms
from quad_env.robots.robot import Robot


class MotionState(NamedTuple):
    """Motion, command and dynamics terms of n robots; `compute_motion_state` computes them.

    The level frame has its origin at the trunk centre, x along the heading and z up.
    """

    tilt: Floats
    """Roll and pitch of the trunk, (n, 2), rad."""
    rotation: Floats
    """Rotation matrix from the base frame to the level frame (trunk centre, x ahead, z up), (n, 3, 3)."""
    velocity: Floats
    """Velocity of the trunk centre, level frame (x along the heading, z up), (n, 3), m/s."""
    angular_velocity: Floats
    """Angular velocity of the trunk, level frame (x along the heading, z up), (n, 3), rad/s."""
    generalised_velocity: Floats
    """Generalised velocity of trunk and joints, as in `quad_env.physics.dynamics`, (n, 18).

    The components are: velocity of the trunk centre, level frame (x along the heading, z up), m/s; angular velocity,
    base frame, rad/s; and joint speeds, rad/s."""
    joint_position: Floats
    """Joint angles, (n, 12), rad."""
    targets: Floats
    """Joint targets of the last control period, the previous action, (n, 12), rad."""
    command: Floats
    """Velocity command: forward velocity, m/s, lateral velocity, m/s, and yaw rate, rad/s, (n, 3)."""
    bodies: DynamicsTerms
    """Terms of the equations of motion in this state, for example inertia, bias force and Jacobians."""
    foot_velocity: Floats
    """Velocity of the feet, level frame (x along the heading, z up), (n, 4, 3), m/s."""


def compute_motion_state(robot: Robot, dynamics: Dynamics, observation: NDArray[np.float32] | Floats) -> MotionState:
    """Compute the motion state of n robots from their observations.

    Args:
        robot: Robot with the home pose.
        dynamics: Rigid-body dynamics of the robot.
        observation: Observation of n robots, (n, k), with k numbers per robot.

    Returns:
        Motion state of n robots.
    """
    rows = observation.astype(np.float64)
    frame = level_frame(rows[:, OBSERVATION["projected_gravity"]].T)
    tilt = np.array((frame.roll, frame.pitch))
    quaternion, rotation = _attitude(tilt)
    angular_velocity_base = rows[:, OBSERVATION["angular_velocity"]]
    velocity = np.matmul(rotation, rows[:, OBSERVATION["linear_velocity"], None])[..., 0]
    joint_position = rows[:, OBSERVATION["joint_position"]] + robot.home_pose
    joint_speed = rows[:, OBSERVATION["joint_velocity"]]
    generalised_velocity = np.concatenate((velocity, angular_velocity_base, joint_speed), axis=1)
    bodies = dynamics.compute(quaternion, velocity, angular_velocity_base, joint_position, joint_speed)
    return MotionState(
        tilt=tilt.T,
        rotation=rotation,
        velocity=velocity,
        angular_velocity=np.matmul(rotation, angular_velocity_base[..., None])[..., 0],
        generalised_velocity=generalised_velocity,
        joint_position=joint_position,
        targets=rows[:, OBSERVATION["previous_action"]] + robot.home_pose,
        command=rows[:, OBSERVATION["command"]],
        bodies=bodies,
        foot_velocity=np.matmul(bodies.jacobians, generalised_velocity[:, None, :, None])[..., 0],
    )


def _attitude(tilt: Floats) -> tuple[Floats, Floats]:
    """Convert roll and pitch to the rotation from the base frame to the level frame.

    The level frame has x along the heading and z up. The rotation is first by the roll angle about x, then by the pitch
    angle about y.

    Args:
        tilt: Roll and pitch of the trunk, (2, n), rad.

    Returns:
        quaternion: Unit quaternion (w, x, y, z), (n, 4).
        rotation: Rotation matrix, (n, 3, 3).
    """
    cos_half_roll, cos_half_pitch = np.cos(0.5 * tilt)
    sin_half_roll, sin_half_pitch = np.sin(0.5 * tilt)
    quaternion = np.array(
        (
            cos_half_pitch * cos_half_roll,
            cos_half_pitch * sin_half_roll,
            sin_half_pitch * cos_half_roll,
            -sin_half_pitch * sin_half_roll,
        )
    ).T
    cos_roll, cos_pitch = np.cos(tilt)
    sin_roll, sin_pitch = np.sin(tilt)
    # The memory layout is the same for any number of robots, because the last bits of a matrix product depend on the
    # layout.
    rotation = np.zeros((tilt.shape[1], 3, 3))
    rotation[:, 0] = np.array((cos_pitch, sin_pitch * sin_roll, sin_pitch * cos_roll)).T
    rotation[:, 1, 1] = cos_roll
    rotation[:, 1, 2] = -sin_roll
    rotation[:, 2] = np.array((-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll)).T
    return quaternion, rotation
