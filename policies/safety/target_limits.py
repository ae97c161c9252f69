"""Limits of all joint targets: joint range, rate of change, joint speed and predicted servo torque."""

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
    """Limits of joint targets, each a number for all joints or an array, (12,); see `for_robot`."""

    torque: Limit
    """Largest servo torque at a joint speed of zero, predicted for the time at which a target takes effect, N·m."""
    target_rate: Positive = 60.0
    """Largest rate of change of a target, rad/s; the swing of the trot reaches 35 rad/s."""
    joint_speed: Positive = 30.0
    """Speed above which a joint is braked, rad/s: the target may not lie ahead of the angle in the moving direction."""
    no_load_speed: Limit = inf
    """Joint speed at which the limit of the driving torque has fallen linearly to zero, rad/s."""
    delay: NonNegative = 0.0
    """Time from a target to its effect, s. The prediction assumes that the joint keeps its speed during this time."""

    @classmethod
    def for_robot(cls, robot: str | Robot, which: str | Actuator = "ideal") -> "SafetyLimits":
        """Return the limits of a robot with an actuator.

        Bandwidth and winding temperature of the actuator have no effect on the limits. A finite bandwidth only makes
        torques smaller, and a policy does not know the temperature.

        Args:
            robot: Robot or its name.
            which: Actuator or its name.

        Returns:
            The limits.
        """
        robot = get_robot(robot)
        servo = find_actuator(which)

        if servo.curve is None:
            return cls(robot.rated_torque, delay=servo.delay)
        line = servo.curve.resolve(robot)
        return cls(line.peak_torque, no_load_speed=line.no_load_speed, delay=servo.delay)

    @classmethod
    def of(cls, robot: str | Robot, which: str | Actuator = "ideal") -> "SafetyLimits":
        """Call `for_robot(robot, which)`. Deprecated name."""
        return cls.for_robot(robot, which)

    def limit_targets(
        self, robot: Robot, period: float, targets: Floats, previous: Floats, joints: Floats, speeds: Floats
    ) -> Floats:
        """Return the nearest targets within the limits.

        The torque limit is applied after the limits of rate and speed, so that it holds even if the target must jump.
        Only the joint range is applied later.

        Args:
            robot: Robot.
            period: Control period, s.
            targets: Joint targets, (n, 12), rad.
            previous: Targets one control period ago, (n, 12), rad.
            joints: Current joint angles, (n, 12), rad.
            speeds: Current joint speeds, (n, 12), rad/s.

        Returns:
            Joint targets, (n, 12), rad.
        """
        reach = self.target_rate * period
        targets = np.clip(targets, previous - reach, previous + reach)
        targets = np.where(speeds > self.joint_speed, np.minimum(targets, joints), targets)
        targets = np.where(speeds < -self.joint_speed, np.maximum(targets, joints), targets)
        # Limit the servo torque, which is stiffness · (target - angle) - damping · speed.
        damping_torque = robot.servo_damping * speeds
        share = speeds / self.no_load_speed
        backward = self.torque * np.clip(1.0 + share, 0.0, 1.0)
        forward = self.torque * np.clip(1.0 - share, 0.0, 1.0)
        low = (damping_torque - backward) / robot.servo_stiffness
        high = (damping_torque + forward) / robot.servo_stiffness
        effect_joints = joints + self.delay * speeds
        targets = effect_joints + np.clip(targets - effect_joints, low, high)
        return np.clip(targets, robot.joint_lower, robot.joint_upper)
