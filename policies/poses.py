"""Policies that hold a pose: the bases of a learner without a gait."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, Policy, to_actions
from policies.legs.kinematics import joint_targets

CROUCH_HEIGHT = 0.62
"""Height of the hips above the centres of the feet in a crouch, in leg lengths."""


class Stand(Policy):
    """Holds the home pose."""

    name = "stand"
    stiff_servos = True

    @cached_property
    def pose(self) -> Floats:
        """Joint angles of the pose, (12,), rad."""
        return self.robot.home_pose

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        return np.tile(to_actions(self.robot, self.pose), (self.num_envs, 1))


class Crouch(Stand):
    """Holds a pose with bent knees and the feet under the thigh joints, so low that legs can reach out to all sides."""

    name = "crouch"

    @cached_property
    def pose(self) -> Floats:
        """Joint angles of the pose, (12,), rad."""
        outboard = self.robot.side * self.robot.hip_offset
        joints: Floats = joint_targets(self.robot, 0.0, outboard[None], -CROUCH_HEIGHT * self.robot.leg_length)[0]
        return joints
