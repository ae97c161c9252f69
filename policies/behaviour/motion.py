"""Motions of the legs that end: each is asked for targets of the robots that are in it, and starts them anew."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import CONTROL_PERIOD, Floats
from quad_env.robots.robot import HOME_POSE, NUM_JOINTS

Mask = NDArray[np.bool_]
Floating = NDArray[np.floating[Any]]


class Motion(ABC):
    """Joint targets over time for n robots; one robot's depend on its own starts and readings alone."""

    @abstractmethod
    def reset(self, num_envs: int) -> None:
        """Make room for that many robots."""

    @abstractmethod
    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin anew with those robots, whose joints (k, 12), rad, are where the motion starts from."""

    @abstractmethod
    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """One control step of the robots `rows`, (k,): targets (k, 12), rad, for those robots' observations (k, m)."""


def approach(current: Floats, goal: Floats, elapsed: Floating, duration: ArrayLike) -> Floats:
    """The next target on the way to `goal` (k, 12), which takes `duration` s, `elapsed` s of which are over."""
    steps_left = np.maximum((np.asarray(duration) - elapsed) / CONTROL_PERIOD, 0.0) + 1.0
    nearer: Floats = current + (goal - current) / steps_left[:, None]
    return nearer


class Hold(Motion):
    """The home pose, approached within `duration` s."""

    def __init__(self, duration: float = 0.4) -> None:
        self._duration = duration

    def reset(self, num_envs: int) -> None:
        """Make room for that many robots."""
        self._target, self._elapsed = np.tile(HOME_POSE, (num_envs, 1)), np.zeros(num_envs)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin with those robots' joints."""
        self._target[mask], self._elapsed[mask] = joints, 0.0

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        target = approach(
            self._target[rows], np.broadcast_to(HOME_POSE, (len(rows), NUM_JOINTS)), self._elapsed[rows], self._duration
        )
        self._target[rows] = target
        self._elapsed[rows] += CONTROL_PERIOD
        return target


class Damp(Motion):
    """Targets at the joints themselves: of the servo only its damping is left, and the robot sinks slowly."""

    def reset(self, num_envs: int) -> None:
        """Nothing to keep."""

    def start(self, mask: Mask, joints: Floats) -> None:
        """Nothing to begin."""

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """The joints."""
        return joints
