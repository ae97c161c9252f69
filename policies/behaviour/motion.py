"""Motions of the legs that end: each is asked for targets of the robots that are in it, and starts them anew."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import Floats, Mask
from quad_env.robots.robot import Robot

Floating = NDArray[np.floating[Any]]


class Motion(ABC):
    """Joint targets over time for n robots; one robot's depend on its own starts and readings alone."""

    def __init__(self, robot: Robot, control_period: float) -> None:
        """`control_period`: time between two calls of `targets`, s."""
        self._robot, self._period = robot, control_period

    def reset(self, num_envs: int) -> None:
        """Make room for that many robots."""
        self._target, self._ticks = np.tile(self._robot.home_pose, (num_envs, 1)), np.zeros(num_envs, np.int64)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin anew with those robots, whose joints (k, 12), rad, are where the motion starts from."""
        self._target[mask], self._ticks[mask] = joints, 0

    @abstractmethod
    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """One control step of the robots `rows`, (k,): targets (k, 12), rad, for those robots' observations (k, m)."""


def approach(current: Floats, goal: Floats, elapsed: Floating, duration: ArrayLike, control_period: float) -> Floats:
    """The next target on the way to `goal` (k, 12), which takes `duration` s, `elapsed` s of which are over."""
    steps_left = np.maximum((np.asarray(duration) - elapsed) / control_period, 0.0) + 1.0
    nearer: Floats = current + (goal - current) / steps_left[:, None]
    return nearer


HOLD_TIME = 0.4
"""From the joints' pose to the home pose, s."""


class Hold(Motion):
    """The home pose, approached within `HOLD_TIME`."""

    def reset(self, num_envs: int) -> None:
        """Make room for that many robots."""
        super().reset(num_envs)
        self._elapsed = np.zeros(num_envs)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin with those robots' joints."""
        super().start(mask, joints)
        self._elapsed[mask] = 0.0

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        home = np.broadcast_to(self._robot.home_pose, joints.shape)
        target = approach(self._target[rows], home, self._elapsed[rows], HOLD_TIME, self._period)
        self._target[rows] = target
        self._elapsed[rows] += self._period
        return target


class Damp(Motion):
    """Targets at the joints themselves: of the servo only its damping is left, and the robot sinks slowly."""

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """The joints."""
        return joints
