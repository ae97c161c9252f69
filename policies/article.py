"""Gait controller of the source document: `document`, exactly as printed, and `document_repaired`, as intended.

The printed controller collapses, by its axis conventions, and is only for demonstration. Its pitch is an angle from the
+x axis, but the thigh angle is measured from straight down. Its leg length ignores the lateral offset. Its stance
starts half a step behind the end of its swing.
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
    """Gait parameters of the document, with the printed values as defaults."""

    frequency: float = parameter(2.0, limits=(0.1, 50.0))
    """Step frequency of a leg, Hz."""
    step_height: float = parameter(0.15, limits=(-1.0, 1.0))
    """Lift of the foot at mid-swing, m."""
    step_length: float = parameter(0.1, limits=(-1.0, 1.0))
    """Length of a stride, m."""
    body_height: float = parameter(0.25, limits=(-1.0, 1.0))
    """Hip joint above the standing foot, m."""
    foot_line: float = parameter(0.15, limits=(-1.0, 1.0))
    """Lateral distance of the foot from the hip joint, outboard, m."""

    def feet(self, robot: Robot, phase: ArrayLike, stance_start: float) -> Floats:
        """Compute the foot positions at a phase.

        The swing goes from -s/2 to s/2 along a half sine, the stance backward by s on the ground, with s the step
        length.

        Args:
            robot: Robot.
            phase: Global phase, (...), rad.
            stance_start: Start of the stance ahead of the hip, m.

        Returns:
            Foot positions, hip frames, (..., 4, 3), m.
        """
        phases = leg_phases(phase, robot.in_leg_order(TROT_OFFSETS))
        swing = phases < np.pi
        t = np.where(swing, phases, phases - np.pi) / np.pi
        x = np.where(swing, -self.step_length / 2.0 + self.step_length * t, stance_start - self.step_length * t)
        z = np.where(swing, -self.body_height + self.step_height * np.sin(np.pi * t), -self.body_height)
        return np.stack([x, np.broadcast_to(self.foot_line * robot.side, x.shape), z], axis=-1)


def printed_joint_angles(robot: Robot, feet: Floats) -> Floats:
    """Compute the inverse kinematics of the document.

    Args:
        robot: Robot.
        feet: Foot positions, hip frames, (..., 3), m.

    Returns:
        Roll, pitch and knee angles, (..., 3), rad; zero for feet out of reach in the plane of the leg.
    """
    x, y, z = np.moveaxis(feet, -1, 0)
    distance = np.sqrt(x**2 + z**2)
    missed = (distance > robot.leg_length) | (distance < min_leg_length(robot))
    upper, lower = robot.thigh_length, robot.calf_length
    knee = np.arccos(np.clip((upper**2 + lower**2 - distance**2) / (2.0 * upper * lower), -1.0, 1.0)) - np.pi
    # A foot on the hip joint itself (distance 0) has no direction: the printed quotient is 0/0 there.
    safe = np.where(missed | (distance == 0.0), robot.leg_length, distance)
    inner = np.arccos(np.clip((upper**2 + safe**2 - lower**2) / (2.0 * upper * safe), -1.0, 1.0))
    pitch = np.arctan2(z, x) - inner
    roll = np.arctan2(y, distance)
    return np.where(missed[..., None], 0.0, np.stack([roll, pitch, knee], axis=-1))


class Document(GaitedPolicy):
    """Printed controller: no command, no observation, no blending, targets clipped to the joint limits.

    Args:
        parameters: Parameters; the printed ones by default.
        **kwargs: See `Policy`.
    """

    name = "document"

    def __init__(self, parameters: PrintedGait | None = None, **kwargs: Unpack[PolicyKwargs]) -> None:
        super().__init__(**kwargs)
        self.parameters = parameters or PrintedGait()
        self.frequency = self.parameters.frequency
        self.leg_offsets = self.robot.in_leg_order(TROT_OFFSETS)

    def targets(self, phase: ArrayLike) -> Floats:
        """Return the raw targets, (..., 12), rad, before any clipping, at a global `phase`, (...), rad."""
        return flat_joints(printed_joint_angles(self.robot, self.parameters.feet(self.robot, phase, stance_start=0.0)))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._tick()
        return to_actions(self.robot, self.targets(self._phase))


class DocumentRepaired(Document):
    """Printed controller with only the repairs that it needs to walk; starts from the home pose, takes no command.

    Repaired are the kinematics, now exact with the thigh angle measured from straight down, and the stance, which now
    starts at the end of the swing (+s/2 to -s/2). All printed values stay. The lift of 0.15 m under a body height of
    0.25 m needs a calf angle of -2.64 rad at mid-swing, beyond the stop at -2.5 rad. The target is clipped to the stop,
    as on a real joint, and the foot rises 0.04 m less.
    """

    name = "document_repaired"
    blend_time = 0.5
    """Duration of the blend from the home pose to the gait, s: one cycle."""

    def targets(self, phase: ArrayLike) -> Floats:
        """Return the targets, (..., 12), rad, before blending and clipping, at a global `phase`, (...), rad."""
        feet = self.parameters.feet(self.robot, phase, stance_start=self.parameters.step_length / 2.0)
        return flat_joints(joint_angles(self.robot, feet))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._tick()
        return to_actions(self.robot, self._blended(self.targets(self._phase), self.blend_time))
