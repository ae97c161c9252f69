"""Exact kinematics of one leg, joint angles to foot position and back, and the sag of its servos under a load.

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
    """Return the distance from thigh joint to foot with a folded knee, without joint limits, m."""
    return abs(robot.thigh_length - robot.calf_length)


def joint_angles(robot: Robot, feet: ArrayLike) -> Floats:
    """Compute the inverse kinematics of the legs, the inverse of `foot_positions`.

    A foot out of reach gets the angles of the nearest point in reach. Joint limits are ignored.

    Args:
        robot: Robot.
        feet: Foot positions, hip frames, (..., legs, 3), m.

    Returns:
        Joint angles, (..., legs, 3), rad.
    """
    x, y, z = np.moveaxis(np.asarray(feet, dtype=np.float64), -1, 0)
    return np.stack(leg_angles(robot, x, y, z), axis=-1)


def leg_angles(
    robot: Robot, x: Floats, y: Floats, z: Floats, *, legs_first: bool = False
) -> tuple[Floats, Floats, Floats]:
    """Compute the inverse kinematics of `joint_angles` with separate coordinates and angles.

    Args:
        robot: Robot.
        x: Foot position forward, hip frames, (..., legs), or (legs, n) with `legs_first`, m.
        y: Foot position to the left, of the same shape, m.
        z: Foot position up, of the same shape, m.
        legs_first: The legs are the first axis.

    Returns:
        Hip, thigh and calf angles, each of the same shape, rad.
    """
    side, knee = robot.side, robot.knee_direction
    if legs_first:
        side, knee = side[:, None], knee[:, None]
    outboard = side * robot.hip_offset
    # Foot below the thigh joint, in the plane of the leg.
    drop = np.sqrt(np.maximum(y * y + z * z - robot.hip_offset**2, 0.0))
    # The hip angle takes the vector (outboard, -drop) to (y, z): its sine and cosine are their cross and dot product.
    hip = np.arctan2(z * outboard + y * drop, y * outboard - z * drop)
    thigh, calf = _plane_angles(robot, x, drop, knee)
    return hip, thigh, calf


def _plane_angles(robot: Robot, x: Floats, drop: Floats, knee: Floats) -> tuple[Floats, Floats]:
    """Return the thigh and calf angles, rad, of a foot at x and `drop` below the thigh joint in the leg's plane, m."""
    upper = robot.thigh_length
    lower = robot.calf_length
    squared_length = np.clip(x * x + drop * drop, min_leg_length(robot) ** 2, robot.leg_length**2)
    bend = (squared_length - upper**2 - lower**2) / (2.0 * upper * lower)
    bend = np.clip(bend, -1.0, 1.0)  # rounding alone takes it out
    calf = knee * np.arccos(bend)
    # From the thigh joint, the foot is `along` down the thigh and `behind` off its line (negative: to the front).
    along = upper + lower * bend
    behind = knee * lower * np.sqrt(1.0 - bend * bend)
    # As for the hip: the thigh angle takes (behind, along) to (-x, drop).
    thigh = np.arctan2(-x * along - drop * behind, drop * along - x * behind)
    return thigh, calf


def joint_targets(robot: Robot, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Floats:
    """Compute the joint angles at foot positions, clipped to the joint limits.

    Args:
        robot: Robot.
        x: Foot position forward, hip frames, broadcasts to (n, 4), m.
        y: Foot position to the left, broadcasts to (n, 4), m.
        z: Foot position up, broadcasts to (n, 4), m.

    Returns:
        Joint angles, (n, 12), rad.
    """
    angles = flat_joints(joint_angles(robot, np.stack(np.broadcast_arrays(x, y, z), axis=-1)))
    return np.clip(angles, robot.joint_lower, robot.joint_upper)


def compensate_servo_load(
    robot: Robot, hip: Floats, thigh: Floats, calf: Floats, x: Floats, y: Floats, force: Floats, leg_axis: int = -1
) -> tuple[Floats, Floats, Floats]:
    """Compensate servo sag: joint targets at which the servos hold the given angles under an upward foot force.

    A servo of stiffness k holds its target up to torque/k, and the torque is the force times ∂z/∂(joint). This is y for
    the hip, -x cos(hip) for the thigh and L2 sin(thigh + calf) cos(hip) for the calf. Arrays are (n, 4), or (4, n) with
    `leg_axis` 0.

    Args:
        robot: Robot.
        hip: Hip angles, rad.
        thigh: Thigh angles, rad.
        calf: Calf angles, rad.
        x: Foot positions forward, hip frames, m.
        y: Foot positions to the left, hip frames, m.
        force: Upward forces on the feet, N.
        leg_axis: Axis of the legs, 0 or -1.

    Returns:
        Hip, thigh and calf targets, rad.
    """
    stiffnesses = robot.servo_stiffness.reshape(-1, 3).T
    if leg_axis == 0:
        stiffnesses = stiffnesses[..., None]
    hips, thighs, calves = (force / stiffness for stiffness in stiffnesses)
    thighs = thighs * np.cos(hip)
    calves = calves * np.cos(hip)
    return hip - hips * y, thigh + thighs * x, calf - calves * robot.calf_length * np.sin(thigh + calf)


def leg_height(robot: Robot, gravity: Floats, joints: Floats) -> Floats:
    """Compute the height of the trunk's centre above the underside of its lowest foot.

    On level ground this is the height of the fall rule.

    Args:
        robot: Robot.
        gravity: Unit gravity vector, base frame, (n, 3).
        joints: Joint angles, (n, 12), rad.

    Returns:
        Height, (n,), m.
    """
    feet = foot_positions(robot, joints.reshape(-1, len(robot.leg_names), 3)) + robot.hip_positions
    depth = feet[:, :, 0] * gravity[:, 0:1] + feet[:, :, 1] * gravity[:, 1:2] + feet[:, :, 2] * gravity[:, 2:3]
    height: Floats = depth.max(axis=1) + robot.foot_depth
    return height
