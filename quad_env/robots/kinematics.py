"""Forward kinematics of the legs: positions of the feet, their Jacobians, and depths of the soles.

The functions use the base frame (x forward, y left, z up, fixed to the trunk) and the hip frame of a leg (origin at its
hip joint, axes parallel to the base frame). Joint angles are zero with the legs straight down; hips turn about +x,
thighs and calves about +y.
"""

import numpy as np
from numpy.typing import ArrayLike

from quad_env.columns import Array
from quad_env.robots.feet import depths_below_centre
from quad_env.robots.robot import Robot


def foot_positions(robot: Robot, joints: ArrayLike, *, legs_first: bool = False) -> Array:
    """Compute the position of each foot's centre relative to its hip joint (forward kinematics).

    Args:
        robot: The robot; its leg lengths and hip offset are used.
        joints: Joint angles (hip, thigh, calf), (..., legs, 3), rad; (legs, n, 3) for n robots if `legs_first` is True.
        legs_first: True if the legs are the first axis of `joints`, False if they are the last but one.

    Returns:
        Positions relative to the hip joints, axes of the base frame, same shape as `joints`, m.
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
    """Compute the positions of the foot centres in the world frame (forward kinematics) of n robots.

    Args:
        robot: The robot; its leg lengths and hip positions are used.
        position: Positions of the trunk centres, world frame, (n, 3), m.
        rotation: Rotations from the base frame to the world frame, (n, 3, 3).
        joints: Joint angles, (n, 12), rad.

    Returns:
        Positions of the foot centres, world frame, (n, 4, 3), m.
    """
    base = robot.hip_positions + foot_positions(robot, joints.reshape(-1, len(robot.leg_names), 3))
    # The products are added in a fixed order, because the rounding of a matrix product depends on the batch size.
    products = rotation[:, None] * base[:, :, None]
    return position[:, None] + (products[..., 0] + products[..., 1] + products[..., 2])


def foot_depths(robot: Robot, rotation: Array, joints: Array) -> float | Array:
    """Compute the depth of each foot's lowest point below the foot's centre, along the world's vertical.

    The feet are considered rigid: the ground does not deform them.

    Args:
        robot: The robot; the shapes of its feet are used.
        rotation: Rotations from the base frame to the world frame, of n robots, (n, 3, 3).
        joints: Joint angles of the n robots, (n, 12), rad.

    Returns:
        Depths, (n, 4), m. If all feet are balls, the depth is the same in every pose, and the result is a float: the
        foot radius, m.
    """
    if not robot.foot_points.size:
        return robot.foot_radius
    angles = joints.reshape(-1, len(robot.leg_names), 3)
    return depths_below_centre(robot.foot_points, robot.foot_radii, angles, rotation[:, None, 2, :])


def foot_jacobians(robot: Robot, joints: Array) -> Array:
    """Compute the Jacobian of each foot's position with respect to the joint angles of its leg.

    Args:
        robot: The robot; its leg lengths and hip offset are used.
        joints: Joint angles (hip, thigh, calf) of n robots, (n, 4, 3), rad.

    Returns:
        Jacobians, (n, 4, 3, 3), m/rad: rows are the coordinates x, y, z in the base frame, columns are hip, thigh and
        calf.
    """
    feet = foot_positions(robot, joints)
    hip = joints[..., 0]
    knee = joints[..., 1] + joints[..., 2]
    upper = robot.thigh_length
    lower = robot.calf_length
    # Derivatives of the foot position with respect to calf and thigh angle: forward and upward in the leg's plane.
    by_calf = -lower * np.cos(knee), lower * np.sin(knee)
    by_thigh = by_calf[0] - upper * np.cos(joints[..., 1]), by_calf[1] + upper * np.sin(joints[..., 1])
    jacobians = np.zeros((*joints.shape, 3))
    jacobians[..., 1, 0] = -feet[..., 2]
    jacobians[..., 2, 0] = feet[..., 1]
    for joint, (ahead, up) in ((1, by_thigh), (2, by_calf)):
        jacobians[..., joint] = np.stack((ahead, -up * np.sin(hip), up * np.cos(hip)), axis=-1)
    return jacobians
