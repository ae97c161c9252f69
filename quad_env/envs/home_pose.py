"""Actions from -1 to 1 about the home pose, for learners that explore about zero at unit size, such as plain PPO."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot

Observation = NDArray[np.float32]
Action = NDArray[Any]

AUTHORITY = 0.5
"""Largest offset of a joint target from the home pose unless another is given, rad."""


class HomePoseSpace(Box):
    """Offsets from a robot's home pose in shares of the largest, -1 … 1, (12,): a space that knows what they stand for.

    A learner's file that keeps its action space, as Stable-Baselines3's does, so says how its actions become joint
    targets.

    Args:
        robot: whose home pose.
        authority: largest offset, rad, of every joint or (12,).
    """

    def __init__(self, robot: str | Robot, authority: ArrayLike = AUTHORITY) -> None:
        robot = get_robot(robot)
        super().__init__(-1.0, 1.0, (robot.num_joints,), np.float32)
        self.robot_name = robot.name
        self.home_pose = robot.home_pose.astype(np.float32)
        self.authority = _authority(authority, robot.num_joints)

    def targets(self, actions: ArrayLike) -> Action:
        """Joint targets, rad, (…, 12), of offsets (…, 12); those beyond ±1 count as ±1."""
        offsets: Action = self.authority * np.clip(np.asarray(actions, np.float32), -1.0, 1.0)
        return self.home_pose + offsets


class HomePoseActions(gym.ActionWrapper[Observation, Action, Action], RecordConstructorArgs):
    """A SimpleQuad environment whose actions are a `HomePoseSpace`: at 0 the robot stands.

    Args:
        env: of one robot; `VectorHomePoseActions` is the same of a batch.
        authority: largest offset of a joint target from the home pose, rad, of every joint or (12,).
    """

    def __init__(self, env: gym.Env[Observation, Action], authority: ArrayLike = AUTHORITY) -> None:
        RecordConstructorArgs.__init__(self, authority=authority)
        gym.ActionWrapper.__init__(self, env)
        self.action_space = self._space = HomePoseSpace(_robot_of(env), authority)

    def action(self, action: Action) -> Action:
        """Joint targets, rad, (12,), of an action."""
        return self._space.targets(action)


class VectorHomePoseActions(VectorWrapper):  # takes no parameters in Gymnasium 1.2
    """A batch of SimpleQuad robots whose actions are a `HomePoseSpace`, as of `HomePoseActions`."""

    def __init__(self, env: VectorEnv[Observation, Action, NDArray[Any]], authority: ArrayLike = AUTHORITY) -> None:
        super().__init__(env)
        self.single_action_space = self._space = HomePoseSpace(_robot_of(env), authority)
        self.action_space = batch_space(self._space, env.num_envs)

    def step(self, actions: Action) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Advance all robots by one control period towards the joint targets of the actions, (n, 12)."""
        return self.env.step(self._space.targets(actions))


def _robot_of(env: Any) -> Robot:
    robot = getattr(env.unwrapped, "robot", None)
    if not isinstance(robot, Robot):
        raise ValueError(f"{env} has no home pose: wrap a SimpleQuad environment, or its native batch")
    return robot


def _authority(authority: ArrayLike, joints: int) -> Action:
    array = np.asarray(authority, np.float32)
    if array.shape not in ((), (joints,)) or not (np.isfinite(array) & (array > 0.0)).all():
        raise ValueError(f"authority is a positive number of rad, or ({joints},) of them, got {authority!r}")
    return np.broadcast_to(array, (joints,)).copy()
