"""Environment wrappers with actions in [-1, 1], where 0 is the home pose, for learners such as PPO.

A learner explores around the action 0 at first, so that the robot starts to learn near its home pose.
"""

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
"""Default of the argument `authority`: maximum offset of a joint target from the home pose, rad."""


class HomePoseSpace(Box):
    """Action space [-1, 1], (12,): joint-target offsets from the home pose, divided by the maximum offset.

    The space stores the home pose and the maximum offset. Model files of Stable-Baselines3 include the action space, so
    these files define the conversion of actions to joint targets.

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
        """Convert `actions`, (..., 12), clipped to ±1, to joint targets, (..., 12), rad."""
        offsets: Action = self.authority * np.clip(np.asarray(actions, np.float32), -1.0, 1.0)
        return self.home_pose + offsets


class HomePoseActions(gym.ActionWrapper[Observation, Action, Action], RecordConstructorArgs):
    """Wrapper that gives a single environment the action space `HomePoseSpace`; action 0 is the home pose.

    Args:
        env: Environment of one robot; see `VectorHomePoseActions` for a batch.
        authority: Maximum offset of a joint target from the home pose, rad; one number for all joints, or (12,).
    """

    def __init__(self, env: gym.Env[Observation, Action], authority: ArrayLike = AUTHORITY) -> None:
        RecordConstructorArgs.__init__(self, authority=authority)
        gym.ActionWrapper.__init__(self, env)
        self.action_space = self._space = HomePoseSpace(_find_robot(env), authority)

    def action(self, action: Action) -> Action:
        """Convert an `action` in [-1, 1], (12,), to joint targets, (12,), rad."""
        return self._space.targets(action)


# The base class has no type parameters, because Gymnasium 1.2 does not accept any.
class VectorHomePoseActions(VectorWrapper):
    """Wrapper that gives a vector environment the action space `HomePoseSpace`; action 0 is the home pose.

    Args:
        env: Vector environment of n robots.
        authority: Maximum offset of a joint target from the home pose, rad; one number for all joints, or (12,).
    """

    def __init__(self, env: VectorEnv[Observation, Action, NDArray[Any]], authority: ArrayLike = AUTHORITY) -> None:
        super().__init__(env)
        self.single_action_space = self._space = HomePoseSpace(_find_robot(env), authority)
        self.action_space = batch_space(self._space, env.num_envs)

    def step(self, actions: Action) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Advance all robots by one control period with `actions` in [-1, 1], (n, 12).

        The result is the tuple that `env.step` returns.
        """
        return self.env.step(self._space.targets(actions))


def _find_robot(env: Any) -> Robot:
    """Return the robot model of an environment; raise ValueError if `env` is not a SimpleQuad environment."""
    robot = getattr(env.unwrapped, "robot", None)
    if not isinstance(robot, Robot):
        raise ValueError(f"{env} has no home pose: wrap a SimpleQuad environment, or its native batch")
    return robot


def _check_authority(authority: ArrayLike, num_joints: int) -> Action:
    """Check `authority`, the maximum joint-target offset, and return it for every joint, (12,), rad.

    ValueError is raised if an offset is not positive and finite.
    """
    array = np.asarray(authority, np.float32)
    if array.shape not in ((), (num_joints,)) or not (np.isfinite(array) & (array > 0.0)).all():
        raise ValueError(f"authority is a positive number of rad, or ({num_joints},) of them, got {authority!r}")
    return np.broadcast_to(array, (num_joints,)).copy()
