"""Figures of a robot that no real one has: most often a placeholder, or a model in other units. Nothing is refused."""

from collections.abc import Iterator

import numpy as np

from quad_env.config import GRAVITY
from quad_env.robots.kinematics import foot_positions
from quad_env.robots.robot import Robot
from quad_env.robots.unlikely_inertias import unlikely_armatures, unlikely_inertias

SHORTEST, LONGEST = 0.05, 3.0
"""Legs of quadrupeds with twelve joints, m."""
STRONGEST = 2.5
"""Largest torque in m·g·L, weight times leg length: SimpleQuad has 1.2, the robots of the `robots` extra 0.2 to 0.6."""


def warnings_of(robot: Robot) -> Iterator[str]:
    """What is hard to believe about a robot, a line each."""
    if inertias := unlikely_inertias(robot):
        first = inertias[0]
        links = f"{first.name} and {len(inertias) - 1} more have" if len(inertias) > 1 else f"{first.name} has"
        yield (
            f"{links} a moment of inertia of {first.moment:.3g} kg·m², at {first.mass:.3g} kg within "
            f"{first.reach:.2f} m, where at most {first.largest:.1g} is likely: a placeholder?"
        )
    if heavy := unlikely_armatures(robot):
        first = robot.model.joint(heavy[0]).name
        joints = f"{first} and {len(heavy) - 1} more have" if len(heavy) > 1 else f"{first} has"
        largest = float(robot.model.dof_armature.max())
        yield f"{joints} an armature of up to {largest:.3g} kg·m², as much as whole legs: a placeholder?"
    length, torque, need = robot.leg_length, robot.rated_torque, standing_torque(robot)
    if length > LONGEST:
        yield f"its legs are {length:.3g} m long: a model in millimetres? MJCF is in metres"
    elif length < SHORTEST:
        yield f"its legs are {length:.3g} m long: is the model in metres?"
    if torque > STRONGEST * robot.mass * GRAVITY * length:
        times = f"{torque / need:.0f} times what standing takes"
        yield f"its motors have {torque:.4g} N·m, {times}: a placeholder? Give rated_torque, N·m"
    elif torque < need:
        yield (
            f"its motors have {torque:.3g} N·m, and standing in the home pose takes {need:.3g} N·m: masses in another "
            "unit than kg? Check them, or give rated_torque, N·m"
        )


def standing_torque(robot: Robot) -> float:
    """Largest torque of a thigh or calf joint when four legs carry the robot at rest in the home pose, N·m."""
    foot = foot_positions(robot, robot.home_pose.reshape(1, -1, 3))[0]
    knee = -robot.thigh_length * np.sin(robot.home_pose[1::3])
    levers = np.abs(np.concatenate((foot[:, 0], foot[:, 0] - knee)))
    return float(0.25 * robot.mass * GRAVITY * levers.max())
