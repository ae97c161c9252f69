"""Model of the joint servos, from which model-based controllers compute the joint torques."""

import numpy as np

from policies.gait_cycle import Floats
from quad_env.actuation.models import Actuator, ResolvedTorqueSpeed
from quad_env.columns import ordered_sum
from quad_env.robots.robot import Robot


class ServoModel:
    """Model of the joint servos: PD law, torque limits, and low-pass filter of the joint targets.

    One object serves all robots of a batch, because this model has no state per robot.

    Args:
        robot: Robot with the servo gains.
        actuator: Actuator model of the joints, with delay, bandwidth and torque-speed curve.
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
        """Function that returns the torque limits of the joints at given joint speeds.

        The argument of the function is the joint speeds, (…, 12), rad/s. The result is the minimum and the maximum
        torque, each (…, 12), N·m."""
        self.target_weights = actuator.target_weights(float(robot.model.opt.timestep), period)
        """Weights of the last k joint targets in the mean target that a motor follows in a control period, (k,).

        The newest target comes first. Older targets have a weight because of the delay and the bandwidth of the
        actuator."""

    def filtered_targets(self, targets: Floats) -> Floats:
        """Compute the mean joint targets that the motors follow in each of the last m control periods.

        Delay and bandwidth of the actuator spread a commanded target over several control periods.

        Args:
            targets: Commanded joint targets of the last m + k - 1 control periods, newest first, (m + k - 1, n, 12),
                rad; k is the number of `target_weights`.

        Returns:
            Mean joint targets of each control period, newest first, (m, n, 12), rad.
        """
        if len(self.target_weights) == 1:
            return targets
        count = len(targets) - len(self.target_weights) + 1
        return ordered_sum(weight * targets[age : age + count] for age, weight in enumerate(self.target_weights))

    def torque(self, targets: Floats, angle: Floats, speed: Floats) -> Floats:
        """Compute the joint torques of the servos by their PD law, clipped to the torque limits.

        Args:
            targets: Joint targets that the motors follow, see `filtered_targets`, (n, 12), rad.
            angle: Joint angles, (n, 12), rad.
            speed: Joint speeds, (n, 12), rad/s.

        Returns:
            Joint torques, (n, 12), N·m.
        """
        torque: Floats = self.stiffness * (targets - angle) - self._damping * speed
        return torque.clip(*self.limits(speed))
