"""Limits that every target passes: joint range, rate of change, joint speed and predicted servo torque."""

from dataclasses import dataclass
from math import inf

import numpy as np

from policies.base import CONTROL_PERIOD, Floats
from quad_env.actuation.models import Actuator, actuator
from quad_env.robots.robot import JOINT_LOWER, JOINT_UPPER, TORQUE_LIMIT
from quad_env.robots.simple_quad import SIMPLE_QUAD

SERVO_STIFFNESS, SERVO_DAMPING = 300.0, 10.0
"""Gains of the robot's joint servos, N·m/rad and N·m·s/rad: torque = stiffness (target - angle) - damping · speed."""


@dataclass(frozen=True)
class SafetyLimits:
    """Limits of each joint; the defaults are those of the ideal servo, `of` gives another's."""

    torque: float = TORQUE_LIMIT
    """Servo torque predicted for the moment that a command takes effect, N·m, of a joint at rest."""
    target_rate: float = 60.0
    """Change of a target, rad/s; the trot's swing reaches 35."""
    joint_speed: float = 30.0
    """A joint that turns faster, rad/s, is braked: its target may not lie further along."""
    no_load_speed: float = inf
    """Joint speed, rad/s, towards which the torque that drives a joint on falls to zero, linearly."""
    delay: float = 0.0
    """From a command to its effect, s: the joint turns on for so long."""

    def __post_init__(self) -> None:
        if not min(self.torque, self.target_rate, self.joint_speed, self.no_load_speed) > 0.0:
            raise ValueError("torque, target_rate, joint_speed and no_load_speed must be positive")
        if not 0.0 <= self.delay < inf:
            raise ValueError(f"delay must be a time of at least 0 s, not {self.delay}")

    @classmethod
    def of(cls, which: str | Actuator) -> "SafetyLimits":
        """The limits that an actuator, or that of a name, sets; its bandwidth only makes torques smaller, and how hot
        its windings are a policy does not know."""
        servo = actuator(which)
        if servo.curve is None:
            return cls(delay=servo.delay)
        line = servo.curve.on(SIMPLE_QUAD)
        torque = min(SIMPLE_QUAD.rated_torque, line.stall_torque)
        return cls(torque=torque, no_load_speed=line.no_load_speed, delay=servo.delay)


def limited(targets: Floats, previous: Floats, joints: Floats, speeds: Floats, limits: SafetyLimits) -> Floats:
    """The targets nearest to those given, (n, 12) rad, that keep the limits; joints and speeds are the present ones.

    The torque limit comes last but for the joint range: it holds even where that means a jump of the target.
    """
    reach = limits.target_rate * CONTROL_PERIOD
    targets = np.clip(targets, previous - reach, previous + reach)
    targets = np.where(speeds > limits.joint_speed, np.minimum(targets, joints), targets)
    targets = np.where(speeds < -limits.joint_speed, np.maximum(targets, joints), targets)
    # stiffness (target - angle) = torque + damping · speed, with the torque anywhere within its limits
    damping, share = SERVO_DAMPING * speeds, speeds / limits.no_load_speed
    backward, forward = (limits.torque * np.clip(1.0 + sign * share, 0.0, 1.0) for sign in (1.0, -1.0))
    low, high = (damping - backward) / SERVO_STIFFNESS, (damping + forward) / SERVO_STIFFNESS
    then = joints + limits.delay * speeds
    targets = then + np.clip(targets - then, low, high)
    within: Floats = np.clip(targets, JOINT_LOWER, JOINT_UPPER)
    return within
