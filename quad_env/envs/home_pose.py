"""Actions in [-1, 1] around the home pose, for learners such as PPO that explore around zero."""

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
"""Default of the maximum offset of a joint target from the home pose, rad."""


class HomePoseSpace(Box):
    """Offsets from a robot's home pose as fractions of the maximum offset, [-1, 1], (12,).

    The space stores the home pose and the maximum offset. So a model file that includes its action space, as files of
    Stable-Baselines3 do, defines the conversion of actions to joint targets.

    Args:
        robot: Robot with the home pose, or the name of the robot.
        authority: Maximum offset of a joint target from the home pose, rad; one number for all joints, or (12,).
    """

    def __init__(self, robot: str | Robot, authority: ArrayLike = AUTHORITY) -> None:
        robot = get_robot(robot)
        super().__init__(-1.0, 1.0, (robot.num_joints,), np.float32)
        self.robot_name = robot.name
        self.home_pose = robot.home_pose.astype(np.float32)
        self.authority = _check_authority(authority, robot.num_joints)

    def targets(self, actions: ArrayLike) -> Action:
        """Return the joint targets of `actions`, (..., 12), rad; actions are clipped to ±1."""
        offsets: Action = self.authority * np.clip(np.asarray(actions, np.float32), -1.0, 1.0)
        return self.home_pose + offsets


class HomePoseActions(gym.ActionWrapper[Observation, Action, Action], RecordConstructorArgs):
    """Wrapper of a single environment with actions in a `HomePoseSpace`; action 0 is the home pose.

    Args:
        env: Environment of one robot; see `VectorHomePoseActions` for a batch.
        authority: Maximum offset of a joint target from the home pose, rad; one number for all joints, or (12,).
    """

    def __init__(self, env: gym.Env[Observation, Action], authority: ArrayLike = AUTHORITY) -> None:
        RecordConstructorArgs.__init__(self, authority=authority)
        gym.ActionWrapper.__init__(self, env)
        self.action_space = self._space = HomePoseSpace(_find_robot(env), authority)

    def action(self, action: Action) -> Action:
        """Return the joint targets of an `action`, (12,), rad."""
        return self._space.targets(action)


class VectorHomePoseActions(VectorWrapper):  # without type parameters, because Gymnasium 1.2 takes none
    """Wrapper of a batch of SimpleQuad robots with actions in a `HomePoseSpace`; see `HomePoseActions`.

    Args:
        env: Vector environment of n robots.
        authority: Maximum offset of a joint target from the home pose, rad; one number for all joints, or (12,).
    """

    def __init__(self, env: VectorEnv[Observation, Action, NDArray[Any]], authority: ArrayLike = AUTHORITY) -> None:
        super().__init__(env)
        self.single_action_space = self._space = HomePoseSpace(_find_robot(env), authority)
        self.action_space = batch_space(self._space, env.num_envs)

    def step(self, actions: Action) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Advance all robots by one control period with `actions`, (n, 12); return the results of `env.step`."""
        return self.env.step(self._space.targets(actions))


def _find_robot(env: Any) -> Robot:
    """Return the robot of an environment; raise ValueError if it is not a SimpleQuad environment."""
    robot = getattr(env.unwrapped, "robot", None)
    if not isinstance(robot, Robot):
        raise ValueError(f"{env} has no home pose: wrap a SimpleQuad environment, or its native batch")
    return robot


def _check_authority(authority: ArrayLike, num_joints: int) -> Action:
    """Return the maximum offset of every joint, (12,), rad.

    ValueError is raised if an offset is not positive and finite.
    """
    array = np.asarray(authority, np.float32)
    if array.shape not in ((), (num_joints,)) or not (np.isfinite(array) & (array > 0.0)).all():
        raise ValueError(f"authority is a positive number of rad, or ({num_joints},) of them, got {authority!r}")
    return np.broadcast_to(array, (num_joints,)).copy()
