"""Limits that every target passes: joint range, rate of change, joint speed and predicted servo torque."""

import sys
from dataclasses import dataclass
from math import inf
from typing import Annotated

import numpy as np

from policies.base import Floats
from quad_env.actuation.models import Actuator, find_actuator
from quad_env.config import Bounds, NonNegative, Positive, Settings
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot

Limit = Annotated[float | Floats, Bounds("more than 0", sys.float_info.min, inf)]


@dataclass(frozen=True)
class SafetyLimits(Settings):
    """Limits of all joints or, (12,), of each; `of` gives a robot's."""

    torque: Limit
    """Servo torque predicted for the moment that a command takes effect, N·m, of a joint at rest."""
    target_rate: Positive = 60.0
    """Change of a target, rad/s; the trot's swing reaches 35."""
    joint_speed: Positive = 30.0
    """A joint that turns faster, rad/s, is braked: its target may not lie further along."""
    no_load_speed: Limit = inf
    """Joint speed, rad/s, towards which the torque that drives a joint on falls to zero, linearly."""
    delay: NonNegative = 0.0
    """From a command to its effect, s: the joint turns on for so long."""

    @classmethod
    def of(cls, robot: str | Robot, which: str | Actuator = "ideal") -> "SafetyLimits":
        """The limits of a robot with an actuator, or that of a name; its bandwidth only makes torques smaller, and how
        hot its windings are a policy does not know."""
        robot, servo = get_robot(robot), find_actuator(which)
        if servo.curve is None:
            return cls(robot.rated_torque, delay=servo.delay)
        line = servo.curve.resolve(robot)
        return cls(line.peak_torque, no_load_speed=line.no_load_speed, delay=servo.delay)

    def limit_targets(
        self, robot: Robot, period: float, targets: Floats, previous: Floats, joints: Floats, speeds: Floats
    ) -> Floats:
        """The targets nearest to those given, (n, 12) rad, that keep the limits; joints and speeds are the present
        ones, `previous` the targets of `period` s ago.

        The torque limit comes last but for the joint range: it holds even where that means a jump of the target.
        """
        reach = self.target_rate * period
        targets = np.clip(targets, previous - reach, previous + reach)
        targets = np.where(speeds > self.joint_speed, np.minimum(targets, joints), targets)
        targets = np.where(speeds < -self.joint_speed, np.maximum(targets, joints), targets)
        # A servo's torque is stiffness (target - angle) - damping · speed, and may lie anywhere within its limits.
        damping, stiffness, share = robot.servo_damping * speeds, robot.servo_stiffness, speeds / self.no_load_speed
        backward, forward = (self.torque * np.clip(1.0 + sign * share, 0.0, 1.0) for sign in (1.0, -1.0))
        low, high = (damping - backward) / stiffness, (damping + forward) / stiffness
        then = joints + self.delay * speeds
        targets = then + np.clip(targets - then, low, high)
        return np.clip(targets, robot.joint_lower, robot.joint_upper)
