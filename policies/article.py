"""Trot controller from the article that this project started from: as printed, and repaired.

The policy `document` is the printed controller, and `document_repaired` is the repaired controller. The robot collapses
with the printed controller, which serves only as a demonstration. The printed controller has three errors. It measures
the thigh angle from the +x axis, but the robot measures this angle from straight down. The printed formula for the leg
length ignores the lateral offset of the foot from the hip. The printed stance phase starts half a step length behind
the end of the swing phase.
"""

from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import Actions, GaitedPolicy, PolicyKwargs, flat_joints, to_actions
from policies.gait_cycle import TROT_OFFSETS, Floats, leg_phases
from policies.legs.kinematics import joint_angles, min_leg_length
from policies.parameters import Parameters, parameter
from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class PrintedGait(Parameters):
    """Gait parameters of the trot controller from the article, with the values in the article as defaults."""

    frequency: float = parameter(2.0, limits=(0.1, 50.0))
    """Gait frequency: number of gait cycles per second, Hz."""
    step_height: float = parameter(0.15, limits=(-1.0, 1.0))
    """Height of the foot above the ground at mid-swing, m."""
    step_length: float = parameter(0.1, limits=(-1.0, 1.0))
    """Distance that a foot moves forward in its swing phase and backward in its stance phase, m."""
    body_height: float = parameter(0.25, limits=(-1.0, 1.0))
    """Height of the hip joint above a foot in stance, m."""
    foot_line: float = parameter(0.15, limits=(-1.0, 1.0))
    """Lateral distance of each foot from its hip joint, positive away from the trunk, m."""

    def feet(self, robot: Robot, phase: ArrayLike, stance_start: float) -> Floats:
        """Compute the foot positions of the trot in the article at a phase of the gait clock.

        With the step length s, a swing foot moves forward from -s/2 to s/2, and its height follows a half sine. A
        stance foot moves backward by s on the ground.

        Args:
            robot: Robot with the hip joints and the order of the legs.
            phase: Phase of the gait clock, (...), rad.
            stance_start: Forward position of a foot at the start of its stance phase, relative to its hip joint, m.

        Returns:
            Foot positions (fl, fr, hl, hr), each relative to its hip joint (x forward, y left, z up), (..., 4, 3), m.
        """
        phases = leg_phases(phase, robot.in_leg_order(TROT_OFFSETS))
        swing = phases < np.pi
        t = np.where(swing, phases, phases - np.pi) / np.pi
        x = np.where(swing, -self.step_length / 2.0 + self.step_length * t, stance_start - self.step_length * t)
        z = np.where(swing, -self.body_height + self.step_height * np.sin(np.pi * t), -self.body_height)
        return np.stack([x, np.broadcast_to(self.foot_line * robot.side, x.shape), z], axis=-1)


def printed_joint_angles(robot: Robot, feet: Floats) -> Floats:
    """Compute joint angles from foot positions by the inverse kinematics in the article.

    The formulas contradict the joint axes of the robot. With the resulting angles, the feet do not reach the given
    positions.

    Args:
        robot: Robot with the link lengths.
        feet: Foot positions, each relative to its hip joint (x forward, y left, z up), (..., 3), m.

    Returns:
        Angles of the hip, thigh and calf joint, (..., 3), rad; zero for foot positions that a leg cannot reach.
    """
    x, y, z = np.moveaxis(feet, -1, 0)
    distance = np.sqrt(x**2 + z**2)
    missed = (distance > robot.leg_length) | (distance < min_leg_length(robot))
    upper, lower = robot.thigh_length, robot.calf_length
    knee = np.arccos(np.clip((upper**2 + lower**2 - distance**2) / (2.0 * upper * lower), -1.0, 1.0)) - np.pi
    # A distance of 0 is replaced, because the formula of the article would divide 0 by 0.
    safe = np.where(missed | (distance == 0.0), robot.leg_length, distance)
    inner = np.arccos(np.clip((upper**2 + safe**2 - lower**2) / (2.0 * upper * safe), -1.0, 1.0))
    pitch = np.arctan2(z, x) - inner
    roll = np.arctan2(y, distance)
    return np.where(missed[..., None], 0.0, np.stack([roll, pitch, knee], axis=-1))


class Document(GaitedPolicy):
    """Trot controller exactly as it is printed in the article that this project started from.

    The controller ignores the observation, also the velocity command in it. The trot starts at once: the targets are
    not blended with the home pose at the start of an episode. The joint targets are clipped to the joint limits.

    Args:
        parameters: Gait parameters; None for the values in the article.
        **kwargs: Keyword arguments `robot` and `control_period` of `Policy`.
    """

    name = "document"

    def __init__(self, parameters: PrintedGait | None = None, **kwargs: Unpack[PolicyKwargs]) -> None:
        super().__init__(**kwargs)
        self.parameters = parameters or PrintedGait()
        self.frequency = self.parameters.frequency
        self.leg_offsets = self.robot.in_leg_order(TROT_OFFSETS)

    def targets(self, phase: ArrayLike) -> Floats:
        """Return the joint targets at a `phase` of the gait clock, (...), rad.

        The targets, (..., 12), rad, are not yet clipped to the joint limits.
        """
        return flat_joints(printed_joint_angles(self.robot, self.parameters.feet(self.robot, phase, stance_start=0.0)))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._tick()
        return to_actions(self.robot, self.targets(self._phase))


class DocumentRepaired(Document):
    """Trot controller from the article with only the repairs that it needs to walk.

    The controller ignores the velocity command. Its inverse kinematics are exact, with the thigh angle measured from
    straight down. A stance phase starts at the foot position at which the swing phase ends: the foot moves backward
    from +s/2 to -s/2, with the step length s. At the start, the joint targets are blended with the home pose.

    All parameters have the values in the article. The step height of 0.15 m at a body height of 0.25 m needs a calf
    angle of -2.64 rad at mid-swing, beyond the joint limit of -2.5 rad. The target is clipped to this limit, so that
    the foot rises 0.04 m less.
    """

    name = "document_repaired"
    blend_time = 0.5
    """Duration of the transition from the home pose to the gait at the start of an episode, s.

    The transition takes as long as one gait cycle."""

    def targets(self, phase: ArrayLike) -> Floats:
        """Return the joint targets at a `phase` of the gait clock, (...), rad.

        The targets, (..., 12), rad, are not yet blended with the home pose and not clipped to the joint limits.
        """
        feet = self.parameters.feet(self.robot, phase, stance_start=self.parameters.step_length / 2.0)
        return flat_joints(joint_angles(self.robot, feet))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._tick()
        return to_actions(self.robot, self._blended(self.targets(self._phase), self.blend_time))
