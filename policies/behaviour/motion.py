"""Joint motions of robots over time: damping, controlled stop, and sequences of poses such as a jump."""

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
    """Base class of motions: an object of this class computes the joint targets of n robots over time.

    The targets of a robot depend only on the calls of `start` for this robot and on its observations.

    Args:
        robot: Robot that moves.
        control_period: Time between two calls of `targets`, s.
    """

    _target: Floats = per_robot()
    """Joint targets of the last control step; before the first step, the angles at the start; (n, 12), rad."""
    _ticks: NDArray[np.int64] = per_robot(0)
    """Number of control steps since the start of the motion of each robot, (n,)."""

    def __init__(self, robot: Robot, control_period: float) -> None:
        self._robot = robot
        self._period = control_period
        super().__init__(_target=robot.home_pose)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Start the motion of k robots from given joint angles.

        Args:
            mask: True for the k robots that start the motion, (n,) bool.
            joints: Joint angles or last joint targets of these robots, (k, 12), rad.
        """
        self._target[mask] = joints
        self._ticks[mask] = 0

    @abstractmethod
    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Compute the joint targets of k robots for one control step.

        Args:
            rows: Indices of the k robots in the batch, (k,).
            observation: Observation of these robots, (k, m), with m numbers per robot.
            joints: Joint angles of these robots, (k, 12), rad.

        Returns:
            Joint targets, (k, 12), rad.
        """


def interpolate_toward(
    current: Floats, goal: Floats, elapsed: Floating, duration: ArrayLike, control_period: float
) -> Floats:
    """Compute the joint targets of the next control step by linear interpolation to goal angles.

    Args:
        current: Joint targets of k robots in the last control step, (k, 12), rad.
        goal: Joint targets at the end of the interpolation, for the same k robots, (k, 12), rad.
        elapsed: Time since the start of the interpolation, (k,), s.
        duration: Duration of the interpolation from the start to the goal, (k,), s.
        control_period: Control period, s.

    Returns:
        Joint targets of the next control step, (k, 12), rad.
    """
    remaining_steps = np.maximum((np.asarray(duration) - elapsed) / control_period, 0.0) + 1.0
    target: Floats = current + (goal - current) / remaining_steps[:, None]
    return target


class Damp(Motion):
    """Damping of the joints: the targets equal the measured joint angles, so that the robot sinks slowly."""

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Return the current angles `joints`, (k, 12), rad, as targets; `rows` and `observation` are unused."""
        return joints


LOWERING_SPEED = 0.2
"""Vertical speed at which a controlled stop lowers the trunk, m/s.

Above 0.3 m/s, a stop would not count as controlled."""
FOLDING_SPEED = 4.0
"""Largest rate of change of a joint target in a controlled stop, rad/s."""
STOP_HEIGHT = 0.2
"""Height of the hip joints above the centres of the feet at the end of a controlled stop, m.

A robot that folds its knees further falls."""
STOP_OUTWARD = 0.04
"""Lateral distance of each foot outside of its thigh joint in a controlled stop, m.

At a distance of 0 the legs would hang straight down."""


class Stop(Motion):
    """Controlled stop: the feet move below the hips, and the hips sink slowly to STOP_HEIGHT."""

    _height: Floats = per_robot(0.0)
    """Commanded height of the hip joints above the centres of the feet, (n,), m.

    The height is NaN between the start of a stop and the first control step of the stop."""

    def start(self, mask: Mask, joints: Floats) -> None:
        """Start the controlled stop of k robots.

        Args:
            mask: True for the k robots that stop, (n,) bool.
            joints: Joint angles or last joint targets of these robots, (k, 12), rad.
        """
        super().start(mask, joints)
        self._height[mask] = np.nan

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Compute the joint targets of k robots in a controlled stop, for one control step.

        Args:
            rows: Indices of the k robots in the batch, (k,).
            observation: Observation of these robots, (k, m), with m numbers per robot.
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
    """Return the four keyframes of the jump: crouch; thrust; flight and landing; stand.

    A random search has found the keyframes. The search minimised the pitch angle of the trunk among jumps that lift the
    trunk by at least 0.165 m. The trunk pitches because all knees bend backward. At take-off the feet are behind the
    hips, because this reduces the pitch angle.

    Args:
        robot: Robot; the last keyframe is its home pose.

    Returns:
        One tuple of four numbers for each keyframe. The first two numbers are the forward position of the feet relative
        to the hips, m, and the height of the hips above the centres of the feet, m. The last two numbers are the
        duration of the motion to this pose, s, and the time for which the pose is held, s.
    """
    return (
        (0.007, 0.377, 0.35, 0.1),
        (-0.051, 0.551, 0.06, 0.02),
        (0.08, 0.422, 0.1, 0.58),
        (0.0, robot.home_height - robot.foot_depth + robot.hip_rise, 0.4, 0.0),
    )


class PoseSequence(Motion):
    """Motion through a fixed sequence of poses, with linear interpolation between them.

    Args:
        robot: Robot that moves.
        control_period: Time between two calls of `targets`, s.
        poses: Joint angles of each of the p poses of the sequence, (p, 12), rad.
        durations: Duration of the motion to each pose, (p,), s.
        holds: Time for which each pose is held, (p,), s.
    """

    def __init__(
        self, robot: Robot, control_period: float, poses: Floats, durations: ArrayLike, holds: ArrayLike
    ) -> None:
        super().__init__(robot, control_period)
        self._poses = poses
        self._durations = np.asarray(durations)
        self._begins = np.concatenate(([0.0], np.cumsum(self._durations + holds)[:-1]))

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Compute the joint targets of k robots on their way through the poses, for one control step.

        Args:
            rows: Indices of the k robots in the batch, (k,).
            observation: Observation of these robots, (k, m), with m numbers per robot.
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
"""Duration of the motion to the home pose when a robot enters the behaviour `State.STAND`, s."""


def make_hold(robot: Robot, control_period: float) -> PoseSequence:
    """Make the motion of a robot to its home pose, which it reaches after HOLD_TIME and then holds.

    Args:
        robot: Robot with the home pose.
        control_period: Time between two control steps, s.

    Returns:
        The motion.
    """
    return PoseSequence(robot, control_period, robot.home_pose[None], [HOLD_TIME], [0.0])


def make_jump(robot: Robot, control_period: float) -> PoseSequence:
    """Make the motion of a jump in place from the poses of `jump_keyframes`.

    After the flight, the compliance of the joint servos absorbs the landing.

    Args:
        robot: Robot that jumps.
        control_period: Time between two control steps, s.

    Returns:
        The motion.
    """
    forwards, heights, durations, holds = np.transpose(jump_keyframes(robot))
    frames = zip(forwards, heights, strict=True)
    feet = [[(forward, side * robot.hip_offset, -height) for side in robot.side] for forward, height in frames]
    return PoseSequence(robot, control_period, joint_angles(robot, feet).reshape(len(feet), -1), durations, holds)
