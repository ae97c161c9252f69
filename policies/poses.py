"""Policies that hold a pose: what a learner begins from that is to have no gait for a base."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, Policy, to_actions
from policies.legs.kinematics import joint_targets

CROUCH_HEIGHT = 0.62
"""Hips of the crouch above the centres of the feet, in lengths of a leg."""


class Stand(Policy):
    """Home pose, always."""

    name = "stand"
    stiff_servos = True

    @cached_property
    def pose(self) -> Floats:
        """Joint angles that it holds, rad, (12,)."""
        return self.robot.home_pose

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        return np.tile(to_actions(self.robot, self.pose), (self.num_envs, 1))


class Crouch(Stand):
    """Knees bent, the feet under the thigh joints, always: low enough for every leg to reach out to all sides."""

    name = "crouch"

    @cached_property
    def pose(self) -> Floats:
        """Joint angles that it holds, rad, (12,)."""
        outboard = self.robot.side * self.robot.hip_offset
        joints: Floats = joint_targets(self.robot, 0.0, outboard[None], -CROUCH_HEIGHT * self.robot.leg_length)[0]
        return joints
