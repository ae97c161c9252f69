"""A jump in place: crouch, thrust, flight with bent legs, landing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats
from policies.behaviour.motion import Motion, approach
from policies.legs.kinematics import joint_angles
from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class Keyframe:
    """Where every foot is and how it comes there."""

    forward: float
    """Foot ahead of its hip, m."""
    height: float
    """Hip above the foot's centre, m."""
    duration: float
    """Way there, s."""
    hold: float = 0.0
    """s there before the next."""


def keyframes_of(robot: Robot) -> tuple[Keyframe, ...]:
    """Crouch, thrust, flight and landing, stand.

    From a random search for the least pitch at 0.165 m of rise or more: knees that all bend backward turn the trunk,
    and the feet behind the hips at take-off make up for part of it.
    """
    return (
        Keyframe(0.007, 0.377, 0.35, 0.1),
        Keyframe(-0.051, 0.551, 0.06, 0.02),
        Keyframe(0.08, 0.422, 0.1, 0.58),
        Keyframe(0.0, robot.home_height - robot.foot_depth + robot.hip_rise, 0.4),
    )


class Jump(Motion):
    """Keyframes by the clock; the joint servos take the landing."""

    def __init__(self, robot: Robot, control_period: float, keyframes: tuple[Keyframe, ...] | None = None) -> None:
        super().__init__(robot, control_period)
        keyframes = keyframes_of(robot) if keyframes is None else keyframes
        feet = [[(key.forward, side * robot.hip_offset, -key.height) for side in robot.side] for key in keyframes]
        self._poses = joint_angles(robot, feet).reshape(len(keyframes), -1)
        self._durations = np.array([key.duration for key in keyframes])
        ends = np.cumsum([key.duration + key.hold for key in keyframes])
        self._begins = np.concatenate(([0.0], ends[:-1]))

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        time = self._ticks[rows] * self._period
        frame = np.searchsorted(self._begins, time + 1e-9, side="right") - 1
        elapsed, duration = time - self._begins[frame], self._durations[frame]
        target = approach(self._target[rows], self._poses[frame], elapsed, duration, self._period)
        self._target[rows] = target
        self._ticks[rows] += 1
        return target
