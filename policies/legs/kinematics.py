"""Exact forward and inverse kinematics of a leg, and compensation of servo sag under a load.

Hip frame: origin at the hip joint, axes parallel to the base frame (x forward, y left, z up). The hip joint rotates the
leg about +x. The thigh joint is at the lateral distance D = `hip_offset` from the hip joint, away from the trunk. The
thigh has the length L1, and the calf has the length L2. Thigh and calf rotate about +y in the leg plane, which the hip
joint tilts. In this plane (x forward, z up before the tilt) the foot is at

    x = -L1 sin(thigh) - L2 sin(thigh + calf)        z = -L1 cos(thigh) - L2 cos(thigh + calf)

and the rotation of the hip joint transforms (x, ±D, z) to the hip frame. Calf angles have the sign of `knee_direction`.
Two hip angles reach the same foot position. The inverse kinematics selects the angle with the foot below the thigh
joint (z <= 0 in the leg plane).
"""

import numpy as np
from numpy.typing import ArrayLike

from policies.base import Floats, flat_joints
from quad_env.robots.kinematics import foot_positions as foot_positions
from quad_env.robots.robot import Robot


def min_leg_length(robot: Robot) -> float:
    """Return the distance from the thigh joint to the foot of a `robot` with a fully folded knee, m.

    The joint limits are ignored.
    """
    return abs(robot.thigh_length - robot.calf_length)


def joint_angles(robot: Robot, feet: ArrayLike) -> Floats:
    """Compute joint angles from foot positions: the inverse kinematics of the legs.

    The function is the inverse of `foot_positions`. If a foot position is out of reach, the result is the angles for
    the nearest reachable position. Joint limits are ignored.

    Args:
        robot: Robot with the link lengths.
        feet: Foot positions, each relative to its hip joint (x forward, y left, z up), (..., legs, 3), m.

    Returns:
        Angles of hip, thigh and calf joint of each leg, (..., legs, 3), rad.
    """
    x, y, z = np.moveaxis(np.asarray(feet, dtype=np.float64), -1, 0)
    return np.stack(leg_angles(robot, x, y, z), axis=-1)


def leg_angles(
    robot: Robot, x: Floats, y: Floats, z: Floats, *, legs_first: bool = False
) -> tuple[Floats, Floats, Floats]:
    """Compute joint angles from foot positions, with a separate array for each coordinate and each angle.

    Args:
        robot: Robot with the link lengths.
        x: Foot position forward of the hip joint, (..., legs), or (legs, n) if `legs_first` is True, m.
        y: Foot position to the left of the hip joint, in the shape of `x`, m.
        z: Foot position above the hip joint (negative below), in the shape of `x`, m.
        legs_first: True if the first axis of the arrays runs over the legs; False if the last axis does.

    Returns:
        Three arrays in the shape of `x`, rad: hip angles, thigh angles and calf angles.
    """
    side, knee = robot.side, robot.knee_direction
    if legs_first:
        side, knee = side[:, None], knee[:, None]
    outboard = side * robot.hip_offset
    # `drop` is the distance of the foot below the thigh joint in the leg plane.
    drop = np.sqrt(np.maximum(y * y + z * z - robot.hip_offset**2, 0.0))
    # The hip rotates the vector (outboard, -drop) to (y, z). The cross product of both vectors is proportional to the
    # sine of the hip angle, and their dot product is proportional to its cosine.
    hip = np.arctan2(z * outboard + y * drop, y * outboard - z * drop)
    thigh, calf = _plane_angles(robot, x, drop, knee)
    return hip, thigh, calf


def _plane_angles(robot: Robot, x: Floats, drop: Floats, knee: Floats) -> tuple[Floats, Floats]:
    """Return the thigh and the calf angles, rad, for a foot position in the leg plane.

    In the leg plane, the foot is at the distance `x` forward and `drop` down from the thigh joint, m. `knee` is the
    sign of the calf angle, see `Robot.knee_direction`.
    """
    upper = robot.thigh_length
    lower = robot.calf_length
    squared_length = np.clip(x * x + drop * drop, min_leg_length(robot) ** 2, robot.leg_length**2)
    bend = (squared_length - upper**2 - lower**2) / (2.0 * upper * lower)
    bend = np.clip(bend, -1.0, 1.0)  # because rounding errors can make the absolute value slightly larger than 1
    calf = knee * np.arccos(bend)
    # The vector from the thigh joint to the foot is split into two components in the leg plane: `along` is parallel to
    # the thigh, and `behind` is perpendicular to the thigh, positive to the rear.
    along = upper + lower * bend
    behind = knee * lower * np.sqrt(1.0 - bend * bend)
    # The thigh angle rotates the vector (behind, along) to (-x, drop). The cross product and the dot product of these
    # two vectors give the sine and the cosine of the thigh angle.
    thigh = np.arctan2(-x * along - drop * behind, drop * along - x * behind)
    return thigh, calf


def joint_targets(robot: Robot, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Floats:
    """Compute joint targets from foot positions: joint angles that are clipped to the joint limits.

    Args:
        robot: Robot with the link lengths and joint limits.
        x: Foot position forward of the hip joint, broadcasts to (n, 4), m.
        y: Foot position to the left of the hip joint, broadcasts to (n, 4), m.
        z: Foot position above the hip joint (negative below), broadcasts to (n, 4), m.

    Returns:
        Joint targets, (n, 12), rad.
    """
    angles = flat_joints(joint_angles(robot, np.stack(np.broadcast_arrays(x, y, z), axis=-1)))
    return np.clip(angles, robot.joint_lower, robot.joint_upper)


def compensate_servo_load(
    robot: Robot, hip: Floats, thigh: Floats, calf: Floats, x: Floats, y: Floats, force: Floats, leg_axis: int = -1
) -> tuple[Floats, Floats, Floats]:
    """Compute joint targets with which the servos hold given angles under an upward force on each foot.

    The joint angle of a servo with stiffness k deviates from its target by torque / k. According to the leg Jacobian,
    the torque is the force times ∂z/∂(joint angle). For the foot position (x, y, z) relative to the hip joint, this
    derivative is y for the hip, -x cos(hip) for the thigh and L2 sin(thigh + calf) cos(hip) for the calf, with the calf
    length L2. All arrays have the shape (n, 4) for n robots, or (4, n) if `leg_axis` is 0.

    Args:
        robot: Robot with the link lengths and the servo stiffness.
        hip: Wanted hip angles, rad.
        thigh: Wanted thigh angles, rad.
        calf: Wanted calf angles, rad.
        x: Foot positions forward of the hip joint, m.
        y: Foot positions to the left of the hip joint, m.
        force: Upward forces on the feet, N.
        leg_axis: Index of the array axis that runs over the legs, 0 or -1.

    Returns:
        Three arrays, rad: targets of the hip, the thigh and the calf joints.
    """
    stiffnesses = robot.servo_stiffness.reshape(-1, 3).T
    if leg_axis == 0:
        stiffnesses = stiffnesses[..., None]
    hips, thighs, calves = (force / stiffness for stiffness in stiffnesses)
    thighs = thighs * np.cos(hip)
    calves = calves * np.cos(hip)
    return hip - hips * y, thigh + thighs * x, calf - calves * robot.calf_length * np.sin(thigh + calf)


def leg_height(robot: Robot, gravity: Floats, joints: Floats) -> Floats:
    """Compute the height of the trunk centre above the sole of the lowest foot, from the joint angles.

    On level ground, this height equals the trunk height that the environment compares with its fall limit.

    Args:
        robot: Robot with the link lengths.
        gravity: Unit gravity vector, base frame, (n, 3).
        joints: Joint angles, (n, 12), rad.

    Returns:
        Height of the trunk centre, (n,), m.
    """
    feet = foot_positions(robot, joints.reshape(-1, len(robot.leg_names), 3)) + robot.hip_positions
    depth = feet[:, :, 0] * gravity[:, 0:1] + feet[:, :, 1] * gravity[:, 1:2] + feet[:, :, 2] * gravity[:, 2:3]
    height: Floats = depth.max(axis=1) + robot.foot_depth
    return height
