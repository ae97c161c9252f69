"""A controlled stop: the trunk is lowered slowly onto folded legs."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, flat_joints
from policies.behaviour.guards import leg_height
from policies.behaviour.motion import Mask, Motion
from policies.legs.kinematics import leg_angles
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot

LOWERING_SPEED = 0.2
"""Speed of the trunk in a controlled stop, m/s; a stop faster than 0.3 would not count as controlled."""
FOLDING_SPEED = 4.0
"""Fastest change of a joint target in a controlled stop, rad/s."""
STOP_HEIGHT = 0.2
"""Hip joints above the feet's centres at the end of a controlled stop, m: as low as the knees fold, and no fall."""


class Stop(Motion):
    """A controlled stop: feet below the hips, trunk lowered slowly, then held there."""

    def reset(self, num_envs: int) -> None:
        """Make room for that many robots."""
        self._target, self._height = np.tile(self._robot.home_pose, (num_envs, 1)), np.zeros(num_envs)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin with those robots' joints."""
        self._target[mask] = joints
        self._height[mask] = np.nan

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        robot = self._robot
        present = leg_height(robot, observation[:, OBSERVATION["projected_gravity"]], joints) - robot.foot_radius
        height = np.where(np.isnan(self._height[rows]), present, self._height[rows])
        height = np.maximum(height - LOWERING_SPEED * self._period, np.minimum(STOP_HEIGHT, present))
        self._height[rows] = height
        goal = feet_at(robot, np.zeros((len(rows), 1)), 0.04 * robot.side + np.zeros((len(rows), 1)), height[:, None])
        reach = FOLDING_SPEED * self._period
        self._target[rows] += np.clip(goal - self._target[rows], -reach, reach)
        return self._target[rows]


def feet_at(robot: Robot, x: Floats, outward: Floats, height: Floats) -> Floats:
    """Joint angles (k, 12) with the feet `height` below the hips, (k, 1), at x (k, 1) and `outward` (k, 4) of a hanging
    leg's place, m; within the joint limits."""
    shape = (len(height), len(robot.side))
    y = robot.hip_offset * robot.side + outward
    legs = leg_angles(robot, np.broadcast_to(x, shape), np.broadcast_to(y, shape), np.broadcast_to(-height, shape))
    angles: Floats = np.clip(flat_joints(np.stack(legs, axis=-1)), robot.joint_lower, robot.joint_upper)
    return angles
