"""The policy that holds the home pose."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Policy, to_actions
from quad_env.robots.robot import HOME_POSE


class Stand(Policy):
    """Home pose, always; also the base of a learner that is to have none."""

    name = "stand"

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        return np.tile(to_actions(HOME_POSE), (self.num_envs, 1))
