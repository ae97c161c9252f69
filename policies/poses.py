"""Policies that hold a pose; a residual that learns without a gait uses one as its base."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, Policy, to_actions
from policies.legs.kinematics import joint_targets

CROUCH_HEIGHT = 0.62
"""Height of the hips above the centres of the feet in a crouch, as a fraction of the leg length."""


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
    """Holds a low pose with bent knees and the feet under the thigh joints.

    The pose is so low that the legs can reach out to all sides.
    """

    name = "crouch"

    @cached_property
    def pose(self) -> Floats:
        """Joint angles of the pose, (12,), rad."""
        outboard = self.robot.side * self.robot.hip_offset
        joints: Floats = joint_targets(self.robot, 0.0, outboard[None], -CROUCH_HEIGHT * self.robot.leg_length)[0]
        return joints
