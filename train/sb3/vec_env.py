"""A Gymnasium vector environment in the protocol of Stable-Baselines3."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices

from train.residual_env import BoolArray, FloatArray

NO_SINGLE_ROBOTS = (
    "robots of a batch are no objects with attributes of their own: make new ones, or call the methods of `env`"
)


class TrainingVecEnv(VecEnv):
    """A vector environment with same-step autoreset in SB3's protocol.

    SB3's log gets return and length of a finished episode if `env` counts them, as Gymnasium's RecordEpisodeStatistics
    does.

    Args:
        env: Environment that is trained on.
        seeds: One for each robot. Every `reset` uses them, until `reset_to_seeds` sets others.
        reward_scale: Factor on the rewards of the learner.
        privileged: Append `infos["privileged"]`, which only the value network may use, to the observations.
        keep_actions: Keep all actions since the start of the robots in `action_log`, so that a run can be resumed. The
            memory grows with every step until `reset_to_seeds`.
    """

    def __init__(
        self,
        env: VectorEnv[FloatArray, FloatArray, NDArray[Any]],
        seeds: Sequence[int],
        reward_scale: float = 1.0,
        privileged: bool = False,
        keep_actions: bool = False,
    ) -> None:
        (seen,) = env.single_observation_space.shape or (0,)
        self.privileged: int = env.unwrapped.privileged_width if privileged else 0  # type: ignore[attr-defined]
        """Number of observations for the value network alone, the last of a row."""
        space = Box(-np.inf, np.inf, (seen + self.privileged,), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)
        self.env = env
        self._episode_seeds = seeds
        self._reward_scale = reward_scale
        self._keep_actions = keep_actions
        self.action_log: list[FloatArray] = []
        """Actions since the start of the robots, each (n, k); empty without `keep_actions`."""
        self._no_infos: list[dict[str, Any]] = [{}] * env.num_envs

    def reset(self) -> FloatArray:
        """Start the first episode of every robot and return the observation, (n, m)."""
        return self.reset_to_seeds(self._episode_seeds)

    def reset_to_seeds(self, seeds: Sequence[int]) -> FloatArray:
        """Start the first episode of every robot with its entry of `seeds`, and return the observation, (n, m)."""
        self._episode_seeds = seeds
        self.action_log = []
        return self._with_privileged(*self.env.reset(seed=seeds))  # type: ignore[arg-type]  # our batches take one each

    def replay(self, seeds: Sequence[int], actions: Sequence[FloatArray]) -> tuple[FloatArray, BoolArray]:
        """Start with given seeds and repeat given actions.

        Args:
            seeds: One for each robot.
            actions: Actions of the steps, each (n, k).

        Returns:
            Last observation, (n, m), and True for robots that start an episode, (n,).
        """
        observation = self.reset_to_seeds(seeds)
        finished = np.ones(self.num_envs, np.bool_)
        for each in actions:
            self.step_async(each)
            observation, _, finished, _ = self.step_wait()
        return observation, finished

    def step_async(self, actions: FloatArray) -> None:
        """Store the actions, (n, k), for `step_wait`."""
        self._actions = actions
        if self._keep_actions:
            self.action_log.append(actions)

    def step_wait(self) -> tuple[FloatArray, FloatArray, BoolArray, list[dict[str, Any]]]:
        """Move the robots.

        Returns:
            Features, scaled rewards, finished episodes, and infos, which are empty for robots that go on.
        """
        observation, rewards, terminated, truncated, infos = self.env.step(self._actions)
        finished = terminated | truncated
        robot_infos = self._no_infos.copy()
        if finished.any():
            final = self._with_privileged(infos["final_obs"], infos.get("final_info", {}))
            for i in np.flatnonzero(finished):
                robot_infos[i] = {"terminal_observation": final[i], "TimeLimit.truncated": not terminated[i]}
                if "episode" in infos:
                    episode = infos["episode"]
                    robot_infos[i]["episode"] = {"r": float(episode["r"][i]), "l": int(episode["l"][i])}
        scaled_rewards = (self._reward_scale * rewards).astype(np.float32)
        return self._with_privileged(observation, infos), scaled_rewards, finished, robot_infos

    def _with_privileged(self, observation: FloatArray, infos: dict[str, Any]) -> FloatArray:
        """Append the observations for the value network alone, if there are any."""
        return np.concatenate((observation, infos["privileged"]), axis=1) if self.privileged else observation

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return the value of `attr_name` for each of the robots in `indices`; they share all attributes."""
        value = None if attr_name == "render_mode" else getattr(self, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise NotImplementedError: the robots are not objects of their own.

        Args:
            attr_name: Not used.
            value: Not used.
            indices: Not used.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError(NO_SINGLE_ROBOTS)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Raise NotImplementedError: the robots are not objects of their own.

        Args:
            method_name: Not used.
            *args: Not used.
            indices: Not used.
            **kwargs: Not used.

        Returns:
            Nothing.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError(NO_SINGLE_ROBOTS)

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each of `indices`; there are no single environments with a `wrapper_class`."""
        return [False for _ in self._get_indices(indices)]
