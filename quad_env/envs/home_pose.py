"""Actions in [-1, 1] around the home pose, for learners that explore around zero at unit size, for example PPO."""

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
"""rad. Default of the maximum offset of a joint target from the home pose."""


class HomePoseSpace(Box):
    """Offsets from a robot's home pose as fractions of the maximum offset, [-1, 1], (12,).

    A model file that stores its action space, as Stable-Baselines3's does, thus defines how its actions become joint
    targets.

    Args:
        robot: Robot with the home pose, or its name.
        authority: Maximum offset, rad, of every joint or (12,).
    """

    def __init__(self, robot: str | Robot, authority: ArrayLike = AUTHORITY) -> None:
        robot = get_robot(robot)
        super().__init__(-1.0, 1.0, (robot.num_joints,), np.float32)
        self.robot_name = robot.name
        self.home_pose = robot.home_pose.astype(np.float32)
        self.authority = _check_authority(authority, robot.num_joints)

    def targets(self, actions: ArrayLike) -> Action:
        """Return the joint targets, rad, (..., 12), of `actions`, (..., 12), which are clipped to ±1."""
        offsets: Action = self.authority * np.clip(np.asarray(actions, np.float32), -1.0, 1.0)
        return self.home_pose + offsets


class HomePoseActions(gym.ActionWrapper[Observation, Action, Action], RecordConstructorArgs):
    """A SimpleQuad environment with actions in a `HomePoseSpace`: at 0 the robot stands.

    Args:
        env: Environment of one robot; `VectorHomePoseActions` is for a batch.
        authority: Maximum offset of a joint target from the home pose, rad, of every joint or (12,).
    """

    def __init__(self, env: gym.Env[Observation, Action], authority: ArrayLike = AUTHORITY) -> None:
        RecordConstructorArgs.__init__(self, authority=authority)
        gym.ActionWrapper.__init__(self, env)
        self.action_space = self._space = HomePoseSpace(_find_robot(env), authority)

    def action(self, action: Action) -> Action:
        """Return the joint targets, rad, (12,), of an `action`."""
        return self._space.targets(action)


class VectorHomePoseActions(VectorWrapper):  # takes no parameters in Gymnasium 1.2
    """A batch of SimpleQuad robots with actions in a `HomePoseSpace`; see `HomePoseActions`.

    Args:
        env: The batch.
        authority: Maximum offset of a joint target from the home pose, rad, of every joint or (12,).
    """

    def __init__(self, env: VectorEnv[Observation, Action, NDArray[Any]], authority: ArrayLike = AUTHORITY) -> None:
        super().__init__(env)
        self.single_action_space = self._space = HomePoseSpace(_find_robot(env), authority)
        self.action_space = batch_space(self._space, env.num_envs)

    def step(self, actions: Action) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Advance all robots by one control period with `actions`, (n, 12); returns the results of the batch's step."""
        return self.env.step(self._space.targets(actions))


def _find_robot(env: Any) -> Robot:
    """Return the robot of an environment; raise ValueError for an environment of another project."""
    robot = getattr(env.unwrapped, "robot", None)
    if not isinstance(robot, Robot):
        raise ValueError(f"{env} has no home pose: wrap a SimpleQuad environment, or its native batch")
    return robot


def _check_authority(authority: ArrayLike, num_joints: int) -> Action:
    """Return the maximum offset of every joint, rad, (12,); raise ValueError unless it is positive and finite."""
    array = np.asarray(authority, np.float32)
    if array.shape not in ((), (num_joints,)) or not (np.isfinite(array) & (array > 0.0)).all():
        raise ValueError(f"authority is a positive number of rad, or ({num_joints},) of them, got {authority!r}")
    return np.broadcast_to(array, (num_joints,)).copy()
