"""A policy that is driven from outside: joint targets while they come, the home pose while they do not."""

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, Floats, Mask, Policy, to_actions
from policies.behaviour.motion import Hold, approach
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

JOIN_TIME = 0.2
"""From where the targets are to those from outside, s, when these begin to be followed."""


class Driven(Policy):
    """Stands until `follow`; every robot of it follows the same targets."""

    name = "driven"

    def __init__(self, *, robot: Robot = SIMPLE_QUAD, control_period: float = CONTROL_PERIOD) -> None:
        super().__init__(robot=robot, control_period=control_period)
        self._outside: Floats | None = None
        self._hold = Hold(robot, control_period)
        self._allocate(1)

    @property
    def following(self) -> bool:
        """Whether it follows targets from outside."""
        return self._outside is not None

    def follow(self, targets: Floats) -> None:
        """Follow these joint targets, (12,), rad, as far as the joints go, until others come."""
        if self._outside is None:
            self._followed_for = 0.0
        self._outside = np.clip(targets, self.robot.joint_lower, self.robot.joint_upper)

    def let_go(self) -> None:
        """Follow nothing any more: from where the targets are to the home pose, and stay there."""
        self._outside = None
        self._hold.start(np.ones(self.num_envs, np.bool_), self._targets)

    def _allocate(self, num_envs: int) -> None:
        self._targets = np.tile(self.robot.home_pose, (num_envs, 1))
        self._outside, self._followed_for = None, 0.0
        self._hold.reset(num_envs)

    def _restart(self, mask: Mask) -> None:
        self._targets[mask] = self.robot.home_pose
        self._hold.start(mask, self._targets[mask])

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        if self._outside is None:
            everyone = np.arange(self.num_envs)
            self._targets = self._hold.targets(everyone, observation.astype(np.float64), self._targets)
        else:
            elapsed = np.full(self.num_envs, self._followed_for)
            self._targets = approach(self._targets, self._outside, elapsed, JOIN_TIME, self.control_period)
            self._followed_for += self.control_period
        return to_actions(self.robot, self._targets)
