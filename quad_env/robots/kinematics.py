"""Where the feet are: exact forward kinematics of the legs.

Hip frame: origin at the hip joint, axes parallel to the base frame (x forward, y left, z up).
"""

from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from quad_env.columns import Array
from quad_env.robots.robot import Robot


def foot_positions(robot: Robot, joints: ArrayLike, side: Array | None = None) -> Array:
    """Feet in their hip frames, m; shape (..., legs, 3), from joint angles in rad of that shape.

    `side` is +1 for a left and -1 for a right leg, shape (legs,) or a scalar array for a single leg's (..., 3); None
    for the robot's legs in their order.
    """
    hip, thigh, calf = np.moveaxis(np.asarray(joints, dtype=np.float64), -1, 0)
    upper, lower = -robot.thigh_length, robot.calf_length
    forward = upper * np.sin(thigh) - lower * np.sin(thigh + calf)
    up = upper * np.cos(thigh) - lower * np.cos(thigh + calf)
    outboard = (robot.side if side is None else side) * robot.hip_offset
    return np.stack(
        [forward, outboard * np.cos(hip) - up * np.sin(hip), outboard * np.sin(hip) + up * np.cos(hip)], axis=-1
    )


def feet_in_world(robot: Robot, position: Array, rotation: Array, joints: Array) -> Array:
    """Centres of the foot spheres in the world frame, (n, 4, 3), m.

    `position`: trunk centres, (n, 3), m; `rotation`: from the base frame to the world frame, (n, 3, 3); `joints`:
    (n, 12), rad.
    """
    base = robot.hip_positions + foot_positions(robot, joints.reshape(-1, len(robot.leg_names), 3))
    # Products summed in order: a robot's bits are the same in a batch of any size, as those of matmul are not.
    turned = [sum(rotation[:, None, row, axis] * base[..., axis] for axis in range(3)) for row in range(3)]
    return cast("Array", position[:, None] + np.stack(turned, axis=-1))
