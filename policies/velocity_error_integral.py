"""Position error of a robot: the integral of its velocity error since the last change of the velocity command."""

import numpy as np

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot


class VelocityErrorIntegral(PerRobotState):
    """Integrates the velocity errors of n robots into position errors.

    The velocity error is commanded minus actual velocity, in the heading frame (yaw only). A new command resets the
    position error to zero. `ConvexMPCLocomotion` in MIT's Cheetah-Software uses a position set point for the same
    purpose.

    Args:
        max_error: Bound of the forward and lateral position error, m, and of the yaw error, rad.
        period: Control period, s.
    """

    position_error: Floats = per_robot(np.zeros(3))
    """Integrated velocity error (commanded minus actual velocity), heading frame (yaw only), (n, 3).

    The numbers are forward and lateral position error, m, and yaw error, rad."""
    _command: Floats = per_robot(np.zeros(3))
    """Velocity command of the last control step, (n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s."""

    def __init__(self, max_error: float, period: float) -> None:
        self._max_error = max_error
        self._period = period
        super().__init__()

    def update(self, command: Floats, velocity: Floats) -> Floats:
        """Add the velocity error of a control step to the position error.

        Args:
            command: Velocity command, (n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
            velocity: Actual velocity, (n, 3), in the same order and units.

        Returns:
            The position error, (n, 3), as in the attribute `position_error`.
        """
        position_error = self.position_error + self._period * (command - velocity)
        self.position_error = position_error.clip(-self._max_error, self._max_error)
        is_same_command = command == self._command
        if np.count_nonzero(is_same_command) < is_same_command.size:
            unchanged = is_same_command.all(axis=1, keepdims=True)
            self.position_error = np.where(unchanged, self.position_error, 0.0)
        self._command = command
        return self.position_error
