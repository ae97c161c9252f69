"""Where the feet are and how they move: exact forward kinematics of the legs.

Hip frame: origin at the hip joint, axes parallel to the base frame (x forward, y left, z up).
"""

import numpy as np
from numpy.typing import ArrayLike

from quad_env.columns import Array
from quad_env.robots.feet import depths_below_centre
from quad_env.robots.robot import Robot


def foot_positions(robot: Robot, joints: ArrayLike, *, legs_first: bool = False) -> Array:
    """Feet in their hip frames, m; shape (..., legs, 3), or (legs, n, 3), from joint angles in rad of that shape."""
    angles = np.asarray(joints, dtype=np.float64)
    thigh, knee = angles[..., 1], angles[..., 1] + angles[..., 2]
    sin, cos = np.sin(angles[..., 0]), np.cos(angles[..., 0])
    upper, lower = -robot.thigh_length, robot.calf_length
    up = upper * np.cos(thigh) - lower * np.cos(knee)
    outboard = (robot.side[:, None] if legs_first else robot.side) * robot.hip_offset
    feet = np.empty_like(angles)
    feet[..., 0] = upper * np.sin(thigh) - lower * np.sin(knee)
    feet[..., 1] = outboard * cos - up * sin
    feet[..., 2] = outboard * sin + up * cos
    return feet


def feet_in_world(robot: Robot, position: Array, rotation: Array, joints: Array) -> Array:
    """Centres of the foot spheres in the world frame, (n, 4, 3), m.

    `position`: trunk centres, (n, 3), m; `rotation`: from the base frame to the world frame, (n, 3, 3); `joints`:
    (n, 12), rad.
    """
    base = robot.hip_positions + foot_positions(robot, joints.reshape(-1, len(robot.leg_names), 3))
    # Summed in order: a robot's bits are the same in a batch of any size, as those of matmul are not.
    products = rotation[:, None] * base[:, :, None]
    return position[:, None] + (products[..., 0] + products[..., 1] + products[..., 2])


def foot_depths(robot: Robot, rotation: Array, joints: Array) -> float | Array:
    """Lowest points of the feet below their centres, m, as if no ground were there: their radius where they are balls,
    else (n, 4); arguments as of `feet_in_world`."""
    if not robot.foot_points.size:
        return robot.foot_radius
    angles = joints.reshape(-1, len(robot.leg_names), 3)
    return depths_below_centre(robot.foot_points, robot.foot_radii, angles, rotation[:, None, 2, :])


def foot_jacobians(robot: Robot, joints: Array) -> Array:
    """Derivatives of `foot_positions` by the angles of a leg's own joints, m/rad, (n, 4, 3, 3)."""
    feet, hip, knee = foot_positions(robot, joints), joints[..., 0], joints[..., 1] + joints[..., 2]
    upper, lower = robot.thigh_length, robot.calf_length
    by_calf = -lower * np.cos(knee), lower * np.sin(knee)  # ahead, and up in the plane of the leg
    by_thigh = by_calf[0] - upper * np.cos(joints[..., 1]), by_calf[1] + upper * np.sin(joints[..., 1])
    jacobians = np.zeros((*joints.shape, 3))
    jacobians[..., 1, 0], jacobians[..., 2, 0] = -feet[..., 2], feet[..., 1]
    for joint, (ahead, up) in ((1, by_thigh), (2, by_calf)):
        jacobians[..., joint] = np.stack((ahead, -up * np.sin(hip), up * np.cos(hip)), axis=-1)
    return jacobians
