"""A jump in place: crouch, thrust, flight with bent legs, landing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Floats
from policies.behaviour.motion import Mask, Motion, approach
from quad_env.robot import HOME_POSE


@dataclass(frozen=True)
class Keyframe:
    """A pose of every leg and how it is come to."""

    leg: tuple[float, float, float]
    """Hip, thigh and calf, rad; a hip is positive outward."""
    duration: float
    """Way there, s."""
    hold: float = 0.0
    """s there before the next."""


JUMP = (
    Keyframe((0.0, 1.1, -2.2), 0.35, 0.1),
    Keyframe((0.0, 0.1, -0.2), 0.09, 0.03),
    Keyframe((0.0, 0.6, -1.2), 0.1, 0.2),
    Keyframe((0.0, 0.5, -1.0), 0.3),
)
"""Crouch, thrust, flight and landing, stand: with the calf at minus twice the thigh the feet stay below the hips."""


class Jump(Motion):
    """Keyframes by the clock; the joint servos take the landing."""

    def __init__(self, keyframes: tuple[Keyframe, ...] = JUMP) -> None:
        mirror = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]] * 2)
        self._poses = np.array([(mirror * key.leg).reshape(-1) for key in keyframes])
        self._durations = np.array([key.duration for key in keyframes])
        ends = np.cumsum([key.duration + key.hold for key in keyframes])
        self._begins = np.concatenate(([0.0], ends[:-1]))

    def reset(self, num_envs: int) -> None:
        """Make room for that many robots."""
        self._target, self._ticks = np.tile(HOME_POSE, (num_envs, 1)), np.zeros(num_envs, np.int64)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin with those robots' joints."""
        self._target[mask], self._ticks[mask] = joints, 0

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        time = self._ticks[rows] * CONTROL_PERIOD
        frame = np.searchsorted(self._begins, time + 1e-9, side="right") - 1
        target = approach(self._target[rows], self._poses[frame], time - self._begins[frame], self._durations[frame])
        self._target[rows] = target
        self._ticks[rows] += 1
        return target
