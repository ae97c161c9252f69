"""Warnings about implausible parameters of a user's robot, such as placeholders or wrong units.

The robot can be used in spite of these warnings.
"""

from collections.abc import Iterator

import numpy as np

from quad_env.config import GRAVITY
from quad_env.robots.kinematics import foot_positions
from quad_env.robots.robot import Robot
from quad_env.robots.unlikely_inertias import find_unlikely_armatures, find_unlikely_inertias

MIN_LEG_LENGTH = 0.05
"""Smallest plausible leg length, m; the lengths of a model with shorter legs are probably not in metres."""
MAX_LEG_LENGTH = 3.0
"""Largest plausible leg length, m; the lengths of a model with longer legs are probably in millimetres."""
MAX_TORQUE_RATIO = 2.5
"""Largest plausible rated torque, divided by the robot's weight times its leg length, dimensionless.

This ratio is 1.2 for SimpleQuad, and 0.2 to 0.6 for the robots of the installation extra `robots`.
"""
MAX_PRINTED_RATIO = 1e6
"""Largest ratio of the rated torque to the torque for standing that a warning prints as a number.

For a larger ratio, the warning prints this number and "or more".
"""
_NEGATIVE = {
    "damping": ("dof_damping", "dof_jntid"),
    "armature": ("dof_armature", "dof_jntid"),
    "friction loss": ("dof_frictionloss", "dof_jntid"),
    "stiffness": ("jnt_stiffness", None),
}
"""Quantity that must not be negative -> fields of `mujoco.MjModel` with its values and with their joints.

Each pair consists of two field names. The first field contains the values. The second field contains the id of the
joint for each row of the first field. The second name is None if row i of the first field belongs to the joint with the
id i.
"""


def find_warnings(robot: Robot) -> Iterator[str]:
    """Yield a one-line warning for each implausible parameter of a robot."""
    yield from _inertia_warnings(robot)
    yield from _negative_values(robot)
    yield from _length_warnings(robot)
    yield from _torque_warnings(robot)


def _inertia_warnings(robot: Robot) -> Iterator[str]:
    """Yield warnings about links with implausibly large inertias and joints with implausibly large armatures."""
    if inertias := find_unlikely_inertias(robot):
        first = inertias[0]
        links = f"{first.name} and {len(inertias) - 1} more have" if len(inertias) > 1 else f"{first.name} has"
        yield (
            f"{links} a moment of inertia of {first.moment:.3g} kg·m², at {first.mass:.3g} kg within "
            f"{first.reach:.2f} m, where at most {first.max_moment:.1g} is likely: a placeholder?"
        )
    if heavy := find_unlikely_armatures(robot):
        first = robot.model.joint(heavy[0]).name
        joints = f"{first} and {len(heavy) - 1} more have" if len(heavy) > 1 else f"{first} has"
        largest = float(robot.model.dof_armature.max())
        yield f"{joints} an armature of up to {largest:.3g} kg·m², as much as whole legs: a placeholder?"


def _length_warnings(robot: Robot) -> Iterator[str]:
    """Yield a warning if the legs are implausibly long or short, most often because of a wrong unit."""
    length = robot.leg_length
    if length > MAX_LEG_LENGTH:
        yield f"its legs are {length:.3g} m long: a model in millimetres? MJCF is in metres"
    elif length < MIN_LEG_LENGTH:
        yield f"its legs are {length:.3g} m long: is the model in metres?"


def _torque_warnings(robot: Robot) -> Iterator[str]:
    """Yield a warning if the motors are implausibly strong, or too weak for the robot to stand."""
    torque = robot.rated_torque
    need = standing_torque(robot)
    if torque > MAX_TORQUE_RATIO * robot.mass * GRAVITY * robot.leg_length:
        times = f"{min(torque / need, MAX_PRINTED_RATIO):.0f} times what standing takes"
        if torque > MAX_PRINTED_RATIO * need:
            times += " or more"
        yield f"its motors have {torque:.4g} N·m, {times}: a placeholder? Give rated_torque, N·m"
    elif torque < need:
        yield (
            f"its motors have {torque:.3g} N·m, and standing in the home pose takes {need:.3g} N·m: masses in another "
            "unit than kg? Check them, or give rated_torque, N·m"
        )


def _negative_values(robot: Robot) -> Iterator[str]:
    """Yield warnings about joints with a negative damping, armature, friction loss or stiffness."""
    model = robot.model
    for quantity, (field, joints) in _NEGATIVE.items():
        rows = np.flatnonzero(getattr(model, field) < 0.0)
        if not rows.size:
            continue
        first = model.joint(int(rows[0] if joints is None else getattr(model, joints)[rows[0]])).name
        subject = f"{first} and {rows.size - 1} more have" if rows.size > 1 else f"{first} has"
        yield f"{subject} a negative {quantity}: it must be at least 0"


def standing_torque(robot: Robot) -> float:
    """Return the largest static torque of a thigh or calf joint when the robot stands in the home pose, N·m.

    Each of the four feet is assumed to carry a quarter of the weight.
    """
    foot = foot_positions(robot, robot.home_pose.reshape(1, -1, 3))[0]
    knee = -robot.thigh_length * np.sin(robot.home_pose[1::3])
    levers = np.abs(np.concatenate((foot[:, 0], foot[:, 0] - knee)))
    return float(0.25 * robot.mass * GRAVITY * levers.max())
