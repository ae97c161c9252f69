"""Policies that hold a fixed pose: `Stand` and `Crouch`."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, Policy, to_actions
from policies.legs.kinematics import joint_targets

CROUCH_HEIGHT = 0.62
"""Height of the hips above the centres of the feet in the pose of `Crouch`, as a fraction of the leg length."""


class Stand(Policy):
    """Policy that holds the home pose of the robot and ignores the velocity command."""

    name = "stand"
    stiff_servos = True

    @cached_property
    def pose(self) -> Floats:
        """Joint angles of the home pose, (12,), rad."""
        return self.robot.home_pose

    @cached_property
    def _action(self) -> Actions:
        """Action of one robot, (1, 12), rad: the joint angles `pose` within the joint limits."""
        return to_actions(self.robot, self.pose)[None]

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        return self._action.repeat(self.num_envs, axis=0)


class Crouch(Stand):
    """Policy that holds a low pose with bent knees, and with the feet under the thigh joints.

    The pose is low enough for the legs to move the feet outward to all sides. The end-to-end training uses this policy
    as its base policy: the network adds corrections to the low pose.
    """

    name = "crouch"

    @cached_property
    def pose(self) -> Floats:
        """Joint angles of the low pose with bent knees, (12,), rad."""
        outboard = self.robot.side * self.robot.hip_offset
        joints: Floats = joint_targets(self.robot, 0.0, outboard[None], -CROUCH_HEIGHT * self.robot.leg_length)[0]
        return joints
