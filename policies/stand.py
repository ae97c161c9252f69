"""The policy that holds the home pose."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Policy, to_actions


class Stand(Policy):
    """Home pose, always; also the base of a learner that is to have none."""

    name = "stand"

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        return np.tile(to_actions(self.robot, self.robot.home_pose), (self.num_envs, 1))
