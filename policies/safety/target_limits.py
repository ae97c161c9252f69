"""Limits that every target passes: joint range, rate of change, joint speed and predicted servo torque."""

from dataclasses import dataclass

import numpy as np

from policies.base import CONTROL_PERIOD, Floats
from quad_env.robots.robot import JOINT_LOWER, JOINT_UPPER, TORQUE_LIMIT

SERVO_STIFFNESS, SERVO_DAMPING = 300.0, 10.0
"""Gains of the robot's joint servos, N·m/rad and N·m·s/rad: torque = stiffness (target - angle) - damping · speed."""


@dataclass(frozen=True)
class SafetyLimits:
    """Of each joint."""

    torque: float = TORQUE_LIMIT
    """Predicted servo torque at the moment of a command, N·m."""
    target_rate: float = 60.0
    """Change of a target, rad/s; the trot's swing reaches 35."""
    joint_speed: float = 30.0
    """A joint that turns faster, rad/s, is braked: its target may not lie further along."""

    def __post_init__(self) -> None:
        if not min(self.torque, self.target_rate, self.joint_speed) > 0.0:
            raise ValueError("torque, target_rate and joint_speed must be positive")


def limited(targets: Floats, previous: Floats, joints: Floats, speeds: Floats, limits: SafetyLimits) -> Floats:
    """The targets nearest to those given, (n, 12) rad, that keep the limits; joints and speeds are the present ones.

    The torque limit comes last but for the joint range: it holds even where that means a jump of the target.
    """
    reach = limits.target_rate * CONTROL_PERIOD
    targets = np.clip(targets, previous - reach, previous + reach)
    targets = np.where(speeds > limits.joint_speed, np.minimum(targets, joints), targets)
    targets = np.where(speeds < -limits.joint_speed, np.maximum(targets, joints), targets)
    # stiffness (target - angle) = torque + damping · speed, with the torque anywhere within its limits
    damping = SERVO_DAMPING * speeds
    low, high = (damping - limits.torque) / SERVO_STIFFNESS, (damping + limits.torque) / SERVO_STIFFNESS
    targets = joints + np.clip(targets - joints, low, high)
    within: Floats = np.clip(targets, JOINT_LOWER, JOINT_UPPER)
    return within
