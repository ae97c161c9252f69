"""Forward kinematics of the legs: positions, depths and Jacobians of the feet.

Hip frame: origin at the hip joint, axes parallel to the base frame (x forward, y left, z up).
"""

import numpy as np
from numpy.typing import ArrayLike

from quad_env.columns import Array
from quad_env.robots.feet import depths_below_centre
from quad_env.robots.robot import Robot


def foot_positions(robot: Robot, joints: ArrayLike, *, legs_first: bool = False) -> Array:
    """Return the foot centres in their hip frames, (..., legs, 3) or (legs, n, 3), m.

    Args:
        robot: The robot.
        joints: Joint angles, (..., legs, 3) or, with `legs_first`, (legs, n, 3), rad.
        legs_first: True if the legs are the first axis of `joints`.

    Returns:
        The foot centres in their hip frames, (..., legs, 3) or (legs, n, 3), m.
    """
    angles = np.asarray(joints, dtype=np.float64)
    thigh = angles[..., 1]
    knee = angles[..., 1] + angles[..., 2]
    sin = np.sin(angles[..., 0])
    cos = np.cos(angles[..., 0])
    upper = -robot.thigh_length
    lower = robot.calf_length
    up = upper * np.cos(thigh) - lower * np.cos(knee)
    outboard = (robot.side[:, None] if legs_first else robot.side) * robot.hip_offset
    feet = np.empty_like(angles)
    feet[..., 0] = upper * np.sin(thigh) - lower * np.sin(knee)
    feet[..., 1] = outboard * cos - up * sin
    feet[..., 2] = outboard * sin + up * cos
    return feet


def feet_in_world(robot: Robot, position: Array, rotation: Array, joints: Array) -> Array:
    """Return the centres of the foot spheres in the world frame, (n, 4, 3), m.

    Args:
        robot: The robot.
        position: Trunk centres, world frame, (n, 3), m.
        rotation: From the base frame to the world frame, (n, 3, 3).
        joints: Joint angles, (n, 12), rad.

    Returns:
        The centres of the foot spheres in the world frame, (n, 4, 3), m.
    """
    base = robot.hip_positions + foot_positions(robot, joints.reshape(-1, len(robot.leg_names), 3))
    # Summed in order: a robot's bits are the same in a batch of any size, unlike the bits of matmul.
    products = rotation[:, None] * base[:, :, None]
    return position[:, None] + (products[..., 0] + products[..., 1] + products[..., 2])


def foot_depths(robot: Robot, rotation: Array, joints: Array) -> float | Array:
    """Return the depths of the feet below their centres: the radius if all feet are balls, else (n, 4), m.

    Feet are undeformed: the ground is disregarded.

    Args:
        robot: The robot.
        rotation: From the base frame to the world frame, (n, 3, 3).
        joints: Joint angles, (n, 12), rad.

    Returns:
        The depths of the feet below their centres: the radius if all feet are balls, else (n, 4), m.
    """
    if not robot.foot_points.size:
        return robot.foot_radius
    angles = joints.reshape(-1, len(robot.leg_names), 3)
    return depths_below_centre(robot.foot_points, robot.foot_radii, angles, rotation[:, None, 2, :])


def foot_jacobians(robot: Robot, joints: Array) -> Array:
    """Return the derivatives of `foot_positions` by the angles of a leg's own joints, (n, 4, 3, 3), m/rad.

    Args:
        robot: The robot.
        joints: Joint angles, (n, 4, 3), rad.

    Returns:
        The derivatives of `foot_positions` by the angles of a leg's own joints, (n, 4, 3, 3), m/rad.
    """
    feet = foot_positions(robot, joints)
    hip = joints[..., 0]
    knee = joints[..., 1] + joints[..., 2]
    upper = robot.thigh_length
    lower = robot.calf_length
    by_calf = -lower * np.cos(knee), lower * np.sin(knee)  # ahead, and up in the plane of the leg
    by_thigh = by_calf[0] - upper * np.cos(joints[..., 1]), by_calf[1] + upper * np.sin(joints[..., 1])
    jacobians = np.zeros((*joints.shape, 3))
    jacobians[..., 1, 0] = -feet[..., 2]
    jacobians[..., 2, 0] = feet[..., 1]
    for joint, (ahead, up) in ((1, by_thigh), (2, by_calf)):
        jacobians[..., joint] = np.stack((ahead, -up * np.sin(hip), up * np.cos(hip)), axis=-1)
    return jacobians
