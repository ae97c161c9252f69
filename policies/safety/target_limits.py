"""Limits of joint targets in the safety layer: joint range, rate of change, joint speed, servo torque."""

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
    """Limits that the safety layer applies to joint targets; `for_robot` makes the limits of a robot.

    The limits `torque` and `no_load_speed` are either one number for all joints or an array, (12,).
    """

    torque: Limit
    """Largest servo torque at a joint speed of zero, N·m.

    A joint target is limited so that the servo torque stays below this limit. The torque is predicted for the time at
    which the target takes effect, see `delay`."""
    target_rate: Positive = 60.0
    """Largest rate of change of a joint target, rad/s. A swing phase of the trot reaches 35 rad/s."""
    joint_speed: Positive = 30.0
    """Joint speed above which a target may not accelerate the joint further, rad/s.

    If a joint is faster, its target is limited to its current angle. The target then does not lie ahead of the joint in
    the direction of motion."""
    no_load_speed: Limit = inf
    """No-load speed of the motors, rad/s; infinite for a torque limit that does not depend on the speed.

    The largest torque in the direction of motion falls linearly from `torque` at standstill to zero at this joint
    speed."""
    delay: NonNegative = 0.0
    """Delay from a joint target to its effect, s.

    The prediction of the servo torque assumes that the joint keeps its speed during the delay."""

    @classmethod
    def for_robot(cls, robot: str | Robot, which: str | Actuator = "ideal") -> "SafetyLimits":
        """Make the limits of the joint targets for a robot with a given actuator model.

        Bandwidth and winding temperature of the actuator have no effect on the limits. A finite bandwidth only makes
        torques smaller, and a policy does not know the temperature.

        Args:
            robot: Robot or its name.
            which: Actuator model of the joints, or its name.

        Returns:
            Limits with the rated torque of the robot, or with the torque-speed curve of the actuator if it has one.
        """
        robot = get_robot(robot)
        servo = find_actuator(which)

        if servo.curve is None:
            return cls(robot.rated_torque, delay=servo.delay)
        line = servo.curve.resolve(robot)
        return cls(line.peak_torque, no_load_speed=line.no_load_speed, delay=servo.delay)

    @classmethod
    def of(cls, robot: str | Robot, which: str | Actuator = "ideal") -> "SafetyLimits":
        """Call `for_robot(robot, which)`. The name `of` is deprecated."""
        return cls.for_robot(robot, which)

    def limit_targets(
        self, robot: Robot, period: float, targets: Floats, previous: Floats, joints: Floats, speeds: Floats
    ) -> Floats:
        """Limit joint targets to the target rate, joint speed, servo torque and joint range.

        The torque limit is applied after the limits of target rate and joint speed, because the torque must be limited
        even if the target then jumps. The limits of the joint range are applied last.

        Args:
            robot: Robot with the servo gains and the joint range.
            period: Control period, s.
            targets: Wanted joint targets, (n, 12), rad.
            previous: Joint targets of the previous control step, (n, 12), rad.
            joints: Current joint angles, (n, 12), rad.
            speeds: Current joint velocities, (n, 12), rad/s.

        Returns:
            Limited joint targets, (n, 12), rad.
        """
        reach = self.target_rate * period
        targets = np.clip(targets, previous - reach, previous + reach)
        targets = np.where(speeds > self.joint_speed, np.minimum(targets, joints), targets)
        targets = np.where(speeds < -self.joint_speed, np.maximum(targets, joints), targets)
        # The servo torque, stiffness · (target - angle) - damping · speed, is solved for the limits of the target.
        damping_torque = robot.servo_damping * speeds
        share = speeds / self.no_load_speed
        backward = self.torque * np.clip(1.0 + share, 0.0, 1.0)
        forward = self.torque * np.clip(1.0 - share, 0.0, 1.0)
        low = (damping_torque - backward) / robot.servo_stiffness
        high = (damping_torque + forward) / robot.servo_stiffness
        effect_joints = joints + self.delay * speeds
        targets = effect_joints + np.clip(targets - effect_joints, low, high)
        return np.clip(targets, robot.joint_lower, robot.joint_upper)
