"""Motions of the legs with an end: each gives the targets of the robots in it, and can restart them."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import Floats, Mask
from policies.legs.kinematics import joint_angles, joint_targets, leg_height
from policies.memory import PerRobotState, per_robot
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot

Floating = NDArray[np.floating[Any]]


class Motion(PerRobotState, ABC):
    """Joint targets over time for n robots; one robot's depend on its own starts and readings alone."""

    _target: Floats = per_robot()
    _ticks: NDArray[np.int64] = per_robot(0)

    def __init__(self, robot: Robot, control_period: float) -> None:
        """`control_period`: time between two calls of `targets`, s."""
        self._robot = robot
        self._period = control_period
        super().__init__(_target=robot.home_pose)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Start the motion of those robots from their joint angles (k, 12), rad."""
        self._target[mask], self._ticks[mask] = joints, 0

    @abstractmethod
    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """One control step of the robots `rows`, (k,): targets (k, 12), rad, for those robots' observations (k, m)."""


def interpolate_toward(
    current: Floats, goal: Floats, elapsed: Floating, duration: ArrayLike, control_period: float
) -> Floats:
    """The next target on the way to `goal` (k, 12), which takes `duration` s, `elapsed` s of which are over."""
    steps_left = np.maximum((np.asarray(duration) - elapsed) / control_period, 0.0) + 1.0
    nearer: Floats = current + (goal - current) / steps_left[:, None]
    return nearer


class Damp(Motion):
    """Targets at the joints themselves: of the servo only its damping is left, and the robot sinks slowly."""

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """The joints."""
        return joints


LOWERING_SPEED = 0.2
"""Speed of the trunk in a controlled stop, m/s; a stop faster than 0.3 would not count as controlled."""
FOLDING_SPEED = 4.0
"""Fastest change of a joint target in a controlled stop, rad/s."""
STOP_HEIGHT = 0.2
"""Hip joints above the feet's centres at the end of a controlled stop, m: as low as the knees fold, and no fall."""
STOP_OUTWARD = 0.04
"""Feet outward of a hanging leg's place, m."""


class Stop(Motion):
    """A controlled stop: feet below the hips, trunk lowered slowly, then held there."""

    _height: Floats = per_robot(0.0)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin with those robots' joints."""
        super().start(mask, joints)
        self._height[mask] = np.nan

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        robot = self._robot
        present = leg_height(robot, observation[:, OBSERVATION["projected_gravity"]], joints)
        present = present - robot.foot_depth + robot.hip_rise
        height = np.where(np.isnan(self._height[rows]), present, self._height[rows])
        height = np.maximum(height - LOWERING_SPEED * self._period, np.minimum(STOP_HEIGHT, present))
        self._height[rows] = height
        y = robot.hip_offset * robot.side + STOP_OUTWARD * robot.side
        goal = joint_targets(robot, 0.0, y, -height[:, None])
        reach = FOLDING_SPEED * self._period
        self._target[rows] += np.clip(goal - self._target[rows], -reach, reach)
        return self._target[rows]


def jump_keyframes(robot: Robot) -> tuple[tuple[float, float, float, float], ...]:
    """Crouch, thrust, flight and landing, stand: every foot ahead of its hip, m, hip above the foot's centre, m, way
    there, s, time there, s.

    From a random search for the least pitch at 0.165 m of rise or more: knees that all bend backward turn the trunk,
    and the feet behind the hips at take-off make up for part of it.
    """
    return (
        (0.007, 0.377, 0.35, 0.1),
        (-0.051, 0.551, 0.06, 0.02),
        (0.08, 0.422, 0.1, 0.58),
        (0.0, robot.home_height - robot.foot_depth + robot.hip_rise, 0.4, 0.0),
    )


class PoseSequence(Motion):
    """Poses (p, 12), rad, by the clock: from the joints at the start to each in its `durations`, s, and there for its
    `holds`, s."""

    def __init__(
        self, robot: Robot, control_period: float, poses: Floats, durations: ArrayLike, holds: ArrayLike
    ) -> None:
        super().__init__(robot, control_period)
        self._poses, self._durations = poses, np.asarray(durations)
        self._begins = np.concatenate(([0.0], np.cumsum(self._durations + holds)[:-1]))

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        time = self._ticks[rows] * self._period
        frame = np.searchsorted(self._begins, time + 1e-9, side="right") - 1
        elapsed, duration = time - self._begins[frame], self._durations[frame]
        target = interpolate_toward(self._target[rows], self._poses[frame], elapsed, duration, self._period)
        self._target[rows] = target
        self._ticks[rows] += 1
        return target


HOLD_TIME = 0.4
"""From the joints' pose to the home pose, s."""


def make_hold(robot: Robot, control_period: float) -> PoseSequence:
    """The home pose, approached within `HOLD_TIME`."""
    return PoseSequence(robot, control_period, robot.home_pose[None], [HOLD_TIME], [0.0])


def make_jump(robot: Robot, control_period: float) -> PoseSequence:
    """Keyframes by the clock; the joint servos take the landing."""
    forwards, heights, durations, holds = np.transpose(jump_keyframes(robot))
    pairs = zip(forwards, heights, strict=True)
    feet = [[(forward, side * robot.hip_offset, -height) for side in robot.side] for forward, height in pairs]
    return PoseSequence(robot, control_period, joint_angles(robot, feet).reshape(len(feet), -1), durations, holds)
