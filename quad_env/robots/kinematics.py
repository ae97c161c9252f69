"""Where the feet are and how they move: exact forward kinematics of the legs.

Hip frame: origin at the hip joint, axes parallel to the base frame (x forward, y left, z up).
"""

import numpy as np
from numpy.typing import ArrayLike

from quad_env.columns import Array
from quad_env.robots.feet import depths
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
    return position[:, None] + _turned(rotation, base)


def foot_depths(robot: Robot, rotation: Array, joints: Array) -> float | Array:
    """Lowest points of the feet below their centres, m, as if no ground were there: their radius where they are balls,
    else (n, 4); arguments as of `feet_in_world`."""
    if not robot.foot_points.size:
        return robot.foot_radius
    angles = joints.reshape(-1, len(robot.leg_names), 3)
    return depths(robot.foot_points, angles, rotation[:, None, 2, :])


def foot_jacobians(robot: Robot, joints: Array) -> Array:
    """Derivatives of `foot_positions` by the angles of a leg's own joints, m/rad, (n, 4, 3, 3)."""
    each = np.eye(3)[:, None, None]
    feet = np.broadcast_to(foot_positions(robot, joints), (len(each), *joints.shape))
    return np.moveaxis(_foot_velocities(robot, joints, each, feet), 0, -1)


def _foot_velocities(robot: Robot, angles: Array, rates: Array, feet: Array) -> Array:
    """Time derivative of `foot_positions`, whose value `feet` are; all (n, 4, 3)."""
    hip, thigh, knee = angles[..., 0], angles[..., 1], angles[..., 1] + angles[..., 2]
    turn, upper = rates[..., 0], -robot.thigh_length * rates[..., 1]
    lower = robot.calf_length * (rates[..., 1] + rates[..., 2])
    up = lower * np.sin(knee) - upper * np.sin(thigh)
    velocities = np.empty_like(feet)
    velocities[..., 0] = upper * np.cos(thigh) - lower * np.cos(knee)
    velocities[..., 1] = -feet[..., 2] * turn - up * np.sin(hip)
    velocities[..., 2] = feet[..., 1] * turn + up * np.cos(hip)
    return velocities


def _turned(rotation: Array, base: Array) -> Array:
    """Vectors of the base frame, (n, k, 3), in the world frame. Products are summed in order: a robot's bits are the
    same in a batch of any size, as those of matmul are not."""
    products = rotation[:, None] * base[:, :, None]
    turned: Array = products[..., 0] + products[..., 1] + products[..., 2]
    return turned
