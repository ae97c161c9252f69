"""Exact forward and inverse kinematics of a leg, and compensation of servo sag under a load.

Hip frame: origin at the hip joint, axes parallel to the base frame (x forward, y left, z up). The hip joint rotates the
leg about +x. The thigh joint is D = `hip_offset` outboard of the hip joint. Thigh and calf, of lengths L1 and L2,
rotate about +y in the plane that the hip has tilted. In this leg plane (x forward, z up before the tilt) a foot is at

    x = -L1 sin(thigh) - L2 sin(thigh + calf)        z = -L1 cos(thigh) - L2 cos(thigh + calf)

and the rotation of the hip takes (x, ±D, z) to the hip frame. Calf angles have the sign of `knee_direction`. A point
can be reached in two ways; the inverse takes the one with the foot below the thigh joint (z <= 0 in the leg plane).
"""

import numpy as np
from numpy.typing import ArrayLike

from policies.base import Floats, flat_joints
from quad_env.robots.kinematics import foot_positions as foot_positions
from quad_env.robots.robot import Robot


def min_leg_length(robot: Robot) -> float:
    """Return the distance from thigh joint to foot with a fully folded knee, ignoring joint limits, m."""
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
    """Compute the inverse kinematics with separate arrays for coordinates and angles.

    Args:
        robot: Robot.
        x: Foot position forward, hip frames, (..., legs), or (legs, n) if `legs_first`, m.
        y: Foot position to the left, same shape, m.
        z: Foot position up, same shape, m.
        legs_first: True if the legs are on the first axis.

    Returns:
        Hip, thigh and calf angles, each of the same shape, rad.
    """
    side, knee = robot.side, robot.knee_direction
    if legs_first:
        side, knee = side[:, None], knee[:, None]
    outboard = side * robot.hip_offset
    # Distance of the foot below the thigh joint, in the leg plane.
    drop = np.sqrt(np.maximum(y * y + z * z - robot.hip_offset**2, 0.0))
    # The hip rotates the vector (outboard, -drop) to (y, z). The cross product of both vectors is proportional to the
    # sine of the hip angle, their dot product to the cosine.
    hip = np.arctan2(z * outboard + y * drop, y * outboard - z * drop)
    thigh, calf = _plane_angles(robot, x, drop, knee)
    return hip, thigh, calf


def _plane_angles(robot: Robot, x: Floats, drop: Floats, knee: Floats) -> tuple[Floats, Floats]:
    """Return thigh and calf angles, rad, for a foot at `x` forward and `drop` below the thigh joint, m."""
    upper = robot.thigh_length
    lower = robot.calf_length
    squared_length = np.clip(x * x + drop * drop, min_leg_length(robot) ** 2, robot.leg_length**2)
    bend = (squared_length - upper**2 - lower**2) / (2.0 * upper * lower)
    bend = np.clip(bend, -1.0, 1.0)  # because rounding can put it slightly outside of [-1, 1]
    calf = knee * np.arccos(bend)
    # Position of the foot relative to the thigh joint: `along` is the component along the thigh, `behind` the component
    # perpendicular to the thigh, negative to the front.
    along = upper + lower * bend
    behind = knee * lower * np.sqrt(1.0 - bend * bend)
    # As for the hip angle: the thigh rotates (behind, along) to (-x, drop).
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
    """Compute the joint targets at which the servos hold given angles under an upward foot force.

    The joint angle of a servo with stiffness k deviates from its target by torque / k. The torque is the force times
    ∂z/∂(joint angle), which is y for the hip, -x cos(hip) for the thigh and L2 sin(thigh + calf) cos(hip) for the calf.
    Arrays are (n, 4), or (4, n) if `leg_axis` is 0.

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
    """Compute the height of the trunk centre above the underside of the lowest foot.

    On level ground this is the trunk height that the fall rule uses.

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
