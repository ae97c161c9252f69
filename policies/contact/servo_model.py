"""Model of the joint servos for model-based controllers."""

import numpy as np

from policies.gait_cycle import Floats
from quad_env.actuation.models import Actuator, ResolvedTorqueSpeed
from quad_env.columns import ordered_sum
from quad_env.robots.robot import Robot


class ServoModel:
    """PD law, torque limits and target filter of the joint servos; one for all robots.

    Args:
        robot: Robot with the servo gains.
        actuator: Drives of the joints.
        period: Control period, s.
    """

    def __init__(self, robot: Robot, actuator: Actuator, period: float) -> None:
        self.stiffness = robot.servo_stiffness
        self._damping = robot.servo_damping
        rated_torque = np.full(len(robot.home_pose), robot.rated_torque)
        if actuator.curve is None:
            curve = ResolvedTorqueSpeed(rated_torque, np.full_like(rated_torque, np.inf), rated_torque)
        else:
            curve = actuator.curve.resolve(robot)
        self.limits = curve.limits
        """Function: joint speeds, (…, 12), rad/s -> minimum and maximum torque, (…, 12) each, N·m."""
        self.target_weights = actuator.target_weights(float(robot.model.opt.timestep), period)
        """Weights of the last k targets in the mean target of a control period, newest first, (k,)."""

    def filtered_targets(self, targets: Floats) -> Floats:
        """Return the mean targets that the motors followed in each of m control periods, newest first.

        Args:
            targets: Commanded targets, newest first, (m + k - 1, n, 12), rad.

        Returns:
            Mean targets, (m, n, 12), rad.
        """
        if len(self.target_weights) == 1:
            return targets
        count = len(targets) - len(self.target_weights) + 1
        return ordered_sum(weight * targets[age : age + count] for age, weight in enumerate(self.target_weights))

    def torque(self, targets: Floats, angle: Floats, speed: Floats) -> Floats:
        """Return the joint torques of the PD law, clipped to the torque limits.

        Args:
            targets: Filtered joint targets, (n, 12), rad.
            angle: Joint angles, (n, 12), rad.
            speed: Joint speeds, (n, 12), rad/s.

        Returns:
            Joint torques, (n, 12), N·m.
        """
        torque: Floats = self.stiffness * (targets - angle) - self._damping * speed
        return torque.clip(*self.limits(speed))
