"""Velocity commands from the sticks of Unitree's remote control, and its stop buttons."""

import numpy as np

from live.unitree.messages import UnitreeMessage
from policies.base import Floats
from quad_env.robots.robot import Robot
from quad_env.scenarios.registry import scenario

STOP_KEYS = 1 << 5 | 1 << 9
"""Bits of the field `keys` of the buttons L2 and B; both together damp the motors."""
_STICKS = {"ly": 1.0, "lx": -1.0, "rx": -1.0}
"""Stick -> its sign in forward and left velocity and yaw rate; lx and rx are positive to the right."""


class RemoteControl:
    """Conversion between stick positions, from -1 to 1, and velocity commands of a robot.

    A stick at its end gives the largest velocity for which the policies of the robot are evaluated.

    Args:
        robot: Robot that is commanded.
    """

    def __init__(self, robot: Robot) -> None:
        ranges = scenario("flat", robot).commands
        low, high = np.transpose((ranges.forward, ranges.lateral, ranges.yaw_rate))
        self._min = -low
        self._max = high

    def command(self, message: UnitreeMessage) -> Floats:
        """Return the velocity command of a message `WirelessController_`.

        Args:
            message: Message with the stick positions; numbers that are not finite count as zero.

        Returns:
            Forward and left velocity, m/s, and yaw rate, rad/s, (3,).
        """
        sticks = np.array([sign * message.get(stick)[0] for stick, sign in _STICKS.items()])
        sticks = np.clip(np.nan_to_num(sticks, posinf=0.0, neginf=0.0), -1.0, 1.0)
        return np.asarray(np.where(sticks < 0.0, sticks * self._min, sticks * self._max))

    def message(self, command: Floats) -> UnitreeMessage:
        """Return the message `WirelessController_` with the stick positions of a velocity command, (3,)."""
        message = UnitreeMessage("WirelessController_")
        sticks = np.clip(np.where(command < 0.0, command / self._min, command / self._max), -1.0, 1.0)
        for (stick, sign), value in zip(_STICKS.items(), sticks, strict=True):
            message.set(stick, sign * value)
        return message


def is_stop(message: UnitreeMessage) -> bool:
    """Return True if a message `WirelessController_` has both stop buttons pressed."""
    return int(message.get("keys")[0]) & STOP_KEYS == STOP_KEYS
