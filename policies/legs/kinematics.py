"""Exact kinematics of one leg, joint angles to foot position and back, and the give of its servos under a load.

Hip frame: origin at the hip joint, axes parallel to the base frame (x forward, y left, z up). The hip turns the leg
about +x; the thigh joint sits D = `hip_offset` outboard of it; thigh and calf, L1 and L2 long, turn about +y in the
plane that the hip has tilted. In that plane (x forward, z towards the hip's own "up") a foot is at

    x = -L1 sin(thigh) - L2 sin(thigh + calf)        z = -L1 cos(thigh) - L2 cos(thigh + calf)

and the hip carries (x, ±D, z) over to the hip frame. Calf angles have the sign of `knee_direction`, and of the two ways
to reach a point the inverse takes the one with the foot below the thigh joint (z <= 0 in the leg's plane).
"""

import numpy as np
from numpy.typing import ArrayLike

from policies.base import Floats, flat_joints
from quad_env.robots.kinematics import foot_positions as foot_positions
from quad_env.robots.robot import Robot


def min_leg_length(robot: Robot) -> float:
    """Thigh joint to foot with the knee folded (joint limits aside), m."""
    return abs(robot.thigh_length - robot.calf_length)


def joint_angles(robot: Robot, feet: ArrayLike) -> Floats:
    """Joint angles in rad that put the feet (hip frames, m) there, shape (..., legs, 3): undoes `foot_positions`.

    A foot out of reach gets the angles of the nearest point in reach. Joint limits are not looked at.
    """
    x, y, z = np.moveaxis(np.asarray(feet, dtype=np.float64), -1, 0)
    return np.stack(leg_angles(robot, x, y, z), axis=-1)


def leg_angles(
    robot: Robot, x: Floats, y: Floats, z: Floats, *, legs_first: bool = False
) -> tuple[Floats, Floats, Floats]:
    """`joint_angles` with coordinates and angles (hip, thigh, calf) apart, each of shape (..., legs), or (legs, n)."""
    upper, lower, offset = robot.thigh_length, robot.calf_length, robot.hip_offset
    side, knee = (each[:, None] if legs_first else each for each in (robot.side, robot.knee_direction))
    outboard = side * offset
    drop = np.sqrt(np.maximum(y * y + z * z - offset**2, 0.0))  # foot below the thigh joint, in the leg's plane
    # The hip angle takes the vector (outboard, -drop) to (y, z): its sine and cosine are their cross and dot product.
    hip = np.arctan2(z * outboard + y * drop, y * outboard - z * drop)

    squared_length = np.clip(x * x + drop * drop, min_leg_length(robot) ** 2, robot.leg_length**2)
    bend = (squared_length - upper**2 - lower**2) / (2.0 * upper * lower)
    bend = np.clip(bend, -1.0, 1.0)  # rounding alone takes it out
    calf = knee * np.arccos(bend)
    # Seen from the thigh, the foot is `along` down the thigh and `behind` off its line (negative: to the front).
    along = upper + lower * bend
    behind = knee * lower * np.sqrt(1.0 - bend * bend)
    # As for the hip: the thigh angle takes (behind, along) to (-x, drop).
    thigh = np.arctan2(-x * along - drop * behind, drop * along - x * behind)
    return hip, thigh, calf


def joint_targets(robot: Robot, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Floats:
    """Joint angles (n, 12), rad, that put the feet (hip frames, m; shapes to broadcast to (n, 4)) there, clipped to the
    joint limits."""
    angles = flat_joints(joint_angles(robot, np.stack(np.broadcast_arrays(x, y, z), axis=-1)))
    return np.clip(angles, robot.joint_lower, robot.joint_upper)


def compensate_servo_load(
    robot: Robot, hip: Floats, thigh: Floats, calf: Floats, x: Floats, y: Floats, force: Floats, leg_axis: int = -1
) -> tuple[Floats, Floats, Floats]:
    """Targets whose joints rest at the given angles under an upward force, N, on a foot at x, y in its hip frame.

    Arrays are (n, 4), or (4, n) with `leg_axis` 0.
    A servo of stiffness k holds its target up to torque/k, and the torque is the force times ∂z/∂(joint), which is
    y for the hip, -x cos(hip) for the thigh and L2 sin(thigh + calf) cos(hip) for the calf.
    """
    stiffnesses = robot.servo_stiffness.reshape(-1, 3).T
    if leg_axis == 0:
        stiffnesses = stiffnesses[..., None]
    hips, thighs, calves = (force / stiffness for stiffness in stiffnesses)
    thighs, calves = thighs * np.cos(hip), calves * np.cos(hip)
    return hip - hips * y, thigh + thighs * x, calf - calves * robot.calf_length * np.sin(thigh + calf)


def leg_height(robot: Robot, gravity: Floats, joints: Floats) -> Floats:
    """Trunk's centre above the underside of its lowest foot, (n,), m, from gravity (n, 3) and joint angles (n, 12): the
    height of the fall rule where the ground is level."""
    feet = foot_positions(robot, joints.reshape(-1, len(robot.leg_names), 3)) + robot.hip_positions
    depth = feet[:, :, 0] * gravity[:, 0:1] + feet[:, :, 1] * gravity[:, 1:2] + feet[:, :, 2] * gravity[:, 2:3]
    height: Floats = depth.max(axis=1) + robot.foot_depth
    return height
