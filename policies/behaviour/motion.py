"""Motions of the legs: damping, a controlled stop, and sequences of poses, for example the jump."""

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
    """Base class of motions: joint targets over time for n robots.

    The targets of a robot depend only on the calls of `start` for this robot and on its observations.

    Args:
        robot: Robot.
        control_period: Time between two calls of `targets`, s.
    """

    _target: Floats = per_robot()
    _ticks: NDArray[np.int64] = per_robot(0)

    def __init__(self, robot: Robot, control_period: float) -> None:
        self._robot = robot
        self._period = control_period
        super().__init__(_target=robot.home_pose)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Start the motion of the k robots in the `mask`, (n,), from the joint angles `joints`, (k, 12), rad."""
        self._target[mask] = joints
        self._ticks[mask] = 0

    @abstractmethod
    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Compute the joint targets of some robots for one control step.

        Args:
            rows: Indices of the robots, (k,).
            observation: Observation of these robots, (k, m).
            joints: Joint angles of these robots, (k, 12), rad.

        Returns:
            Joint targets, (k, 12), rad.
        """


def interpolate_toward(
    current: Floats, goal: Floats, elapsed: Floating, duration: ArrayLike, control_period: float
) -> Floats:
    """Return the joint targets of the next control step on a straight way to a goal.

    Args:
        current: Current targets, (k, 12), rad.
        goal: Targets at the end, (k, 12), rad.
        elapsed: Time since the start, (k,), s.
        duration: Duration of the way from the start to the goal, (k,), s.
        control_period: Control period, s.

    Returns:
        Targets of the next control step, (k, 12), rad.
    """
    remaining_steps = np.maximum((np.asarray(duration) - elapsed) / control_period, 0.0) + 1.0
    target: Floats = current + (goal - current) / remaining_steps[:, None]
    return target


class Damp(Motion):
    """Damping: targets equal the joint angles, so the servos only damp and the robot sinks slowly."""

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Return the joint angles `joints` unchanged; `rows` and `observation` are not used."""
        return joints


LOWERING_SPEED = 0.2
"""Speed at which the trunk is lowered in a controlled stop, m/s; above 0.3 m/s a stop would not count as controlled."""
FOLDING_SPEED = 4.0
"""Largest rate of a joint target in a controlled stop, rad/s."""
STOP_HEIGHT = 0.2
"""Height of the hip joints above the centres of the feet after a controlled stop, m.

The knees cannot fold to a smaller height without a fall."""
STOP_OUTWARD = 0.04
"""Outward distance of the feet from the position of a leg that hangs straight down, m."""


class Stop(Motion):
    """Controlled stop: the feet move below the hips, and the trunk sinks slowly to STOP_HEIGHT."""

    _height: Floats = per_robot(0.0)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Start the motion of the robots in the `mask`, (n,), from their `joints`, (k, 12), rad."""
        super().start(mask, joints)
        self._height[mask] = np.nan

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Compute the joint targets of some robots; see `Motion.targets`.

        Args:
            rows: Indices of the robots, (k,).
            observation: Observation of these robots, (k, m).
            joints: Joint angles of these robots, (k, 12), rad.

        Returns:
            Joint targets, (k, 12), rad.
        """
        robot = self._robot
        measured = leg_height(robot, observation[:, OBSERVATION["projected_gravity"]], joints)
        measured = measured - robot.foot_depth + robot.hip_rise
        height = np.where(np.isnan(self._height[rows]), measured, self._height[rows])
        height = np.maximum(height - LOWERING_SPEED * self._period, np.minimum(STOP_HEIGHT, measured))
        self._height[rows] = height
        y = robot.hip_offset * robot.side + STOP_OUTWARD * robot.side
        goal = joint_targets(robot, 0.0, y, -height[:, None])
        reach = FOLDING_SPEED * self._period
        self._target[rows] += np.clip(goal - self._target[rows], -reach, reach)
        return self._target[rows]


def jump_keyframes(robot: Robot) -> tuple[tuple[float, float, float, float], ...]:
    """Return the keyframes of the jump: crouch, thrust, flight and landing, stand.

    The keyframes come from a random search for the smallest pitch among jumps that rise by 0.165 m or more. The trunk
    pitches because all knees bend backward. The feet are behind the hips at take-off, which reduces this pitch.

    Args:
        robot: Robot.

    Returns:
        Four numbers for each keyframe. Lengths: forward position of the feet relative to the hips, m, and height of the
        hips above the centres of the feet, m. Times: duration of the way to the pose, s, and of the hold, s.
    """
    return (
        (0.007, 0.377, 0.35, 0.1),
        (-0.051, 0.551, 0.06, 0.02),
        (0.08, 0.422, 0.1, 0.58),
        (0.0, robot.home_height - robot.foot_depth + robot.hip_rise, 0.4, 0.0),
    )


class PoseSequence(Motion):
    """Motion through a sequence of poses at fixed times.

    Args:
        robot: Robot.
        control_period: Time between two calls of `targets`, s.
        poses: Joint angles of p poses, (p, 12), rad.
        durations: Duration of the way to each pose, (p,), s.
        holds: Duration of the hold of each pose, (p,), s.
    """

    def __init__(
        self, robot: Robot, control_period: float, poses: Floats, durations: ArrayLike, holds: ArrayLike
    ) -> None:
        super().__init__(robot, control_period)
        self._poses = poses
        self._durations = np.asarray(durations)
        self._begins = np.concatenate(([0.0], np.cumsum(self._durations + holds)[:-1]))

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Compute the joint targets of some robots; see `Motion.targets`.

        Args:
            rows: Indices of the robots, (k,).
            observation: Observation of these robots, (k, m).
            joints: Joint angles of these robots, (k, 12), rad.

        Returns:
            Joint targets, (k, 12), rad.
        """
        time = self._ticks[rows] * self._period
        frame = np.searchsorted(self._begins, time + 1e-9, side="right") - 1
        elapsed = time - self._begins[frame]
        duration = self._durations[frame]
        target = interpolate_toward(self._target[rows], self._poses[frame], elapsed, duration, self._period)
        self._target[rows] = target
        self._ticks[rows] += 1
        return target


HOLD_TIME = 0.4
"""Duration of the motion to the home pose, s."""


def make_hold(robot: Robot, control_period: float) -> PoseSequence:
    """Make the motion of a `robot` to its home pose within HOLD_TIME, for a `control_period`, s."""
    return PoseSequence(robot, control_period, robot.home_pose[None], [HOLD_TIME], [0.0])


def make_jump(robot: Robot, control_period: float) -> PoseSequence:
    """Make the jump of a `robot` for a `control_period`, s; the joint servos absorb the landing."""
    forwards, heights, durations, holds = np.transpose(jump_keyframes(robot))
    frames = zip(forwards, heights, strict=True)
    feet = [[(forward, side * robot.hip_offset, -height) for side in robot.side] for forward, height in frames]
    return PoseSequence(robot, control_period, joint_angles(robot, feet).reshape(len(feet), -1), durations, holds)
