"""A controlled stop: the trunk is lowered slowly onto folded legs."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask
from policies.behaviour.guards import leg_height
from policies.behaviour.motion import Motion
from policies.legs.kinematics import joint_targets
from quad_env import OBSERVATION

LOWERING_SPEED = 0.2
"""Speed of the trunk in a controlled stop, m/s; a stop faster than 0.3 would not count as controlled."""
FOLDING_SPEED = 4.0
"""Fastest change of a joint target in a controlled stop, rad/s."""
STOP_HEIGHT = 0.2
"""Hip joints above the feet's centres at the end of a controlled stop, m: as low as the knees fold, and no fall."""
STOP_OUTWARD = 0.04
"""Feet outward of a hanging leg's place, m."""


class Stop(Motion):
    """A controlled stop: feet below the hips, trunk lowered slowly, then held there."""

    def reset(self, num_envs: int) -> None:
        """Make room for that many robots."""
        super().reset(num_envs)
        self._height = np.zeros(num_envs)

    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin with those robots' joints."""
        super().start(mask, joints)
        self._height[mask] = np.nan

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        robot = self._robot
        present = leg_height(robot, observation[:, OBSERVATION["projected_gravity"]], joints)
        present = present - robot.foot_depth + robot.hip_rise
        height = np.where(np.isnan(self._height[rows]), present, self._height[rows])
        height = np.maximum(height - LOWERING_SPEED * self._period, np.minimum(STOP_HEIGHT, present))
        self._height[rows] = height
        y = robot.hip_offset * robot.side + STOP_OUTWARD * robot.side
        goal = joint_targets(robot, 0.0, y, -height[:, None])
        reach = FOLDING_SPEED * self._period
        self._target[rows] += np.clip(goal - self._target[rows], -reach, reach)
        return self._target[rows]
