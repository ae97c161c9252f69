"""What the document meant: its printed gait with only the repairs that it needs to walk.

Repaired: exact kinematics with the thigh angle measured from straight down, and a stance that starts where the swing
ended (+s/2 to -s/2). Every printed figure stays. The lift of 0.15 m under a body height of 0.25 m asks for a calf
angle of -2.64 rad at mid-swing, past its stop at -2.5 rad: the stop clips it, as it would on a real joint, and the
foot rises 0.04 m less. It takes no command.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.article.printed import PrintedGait
from policies.base import CONTROL_PERIOD, Actions, GaitedPolicy, flat_joints, to_actions
from policies.gait import Floats
from policies.legs.kinematics import joint_angles
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


class DocumentRepaired(GaitedPolicy):
    """The repaired printed controller; starts from the home pose."""

    name = "document_repaired"
    blend_time = 0.5
    """From the home pose to the gait, s: one cycle."""

    def __init__(
        self,
        parameters: PrintedGait | None = None,
        *,
        robot: Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
    ) -> None:
        self.parameters = parameters if parameters is not None else PrintedGait()
        self.frequency = self.parameters.frequency
        super().__init__(robot=robot, control_period=control_period)

    def targets(self, phase: ArrayLike) -> Floats:
        """The 12 targets in rad, before blending and clipping, for a global phase in rad; shape (..., 12) for (...)."""
        feet = self.parameters.feet(self.robot, phase, stance_start=self.parameters.step_length / 2.0)
        return flat_joints(joint_angles(self.robot, feet))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._tick()
        return to_actions(self.robot, self._blended(self.targets(self._phase), self.blend_time))
