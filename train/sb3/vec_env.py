"""Adapter from a Gymnasium vector environment to the `VecEnv` interface of Stable-Baselines3 (SB3)."""

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
    """Adapter that gives a Gymnasium vector environment with same-step autoreset the interface of SB3.

    SB3 logs the return and the length of finished episodes if `env` provides them in `infos["episode"]`, as Gymnasium's
    RecordEpisodeStatistics does.

    Args:
        env: Gymnasium vector environment to train in, with same-step autoreset.
        seeds: Seed of each robot. Every `reset` uses the same seeds, until `reset_to_seeds` sets others.
        reward_scale: Factor on the rewards that the learner receives.
        privileged: True: append `infos["privileged"]`, which only the value network may use, to the observations.
        keep_actions: True: store all actions since the last reset in `action_log`, so that a run can be resumed. The
            log grows with every step until the next reset.
        reward_floor: Lower bound of the reward of a step, before `reward_scale` is applied; None for no bound.
    """

    def __init__(
        self,
        env: VectorEnv[FloatArray, FloatArray, NDArray[Any]],
        seeds: Sequence[int],
        reward_scale: float = 1.0,
        privileged: bool = False,
        keep_actions: bool = False,
        reward_floor: float | None = None,
    ) -> None:
        (seen,) = env.single_observation_space.shape or (0,)
        self.privileged: int = env.unwrapped.privileged_width if privileged else 0  # type: ignore[attr-defined]
        """Number of entries at the end of the observation of a robot that only the value network receives."""
        space = Box(-np.inf, np.inf, (seen + self.privileged,), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)
        self.env = env
        self._episode_seeds = seeds
        self._reward_scale = reward_scale
        self._keep_actions = keep_actions
        self._reward_floor = reward_floor
        self.action_log: list[FloatArray] = []
        """Actions of all n robots since the last reset, one array, (n, 12), per step.

        The list is empty if `keep_actions` is False."""
        self._no_infos: list[dict[str, Any]] = [{}] * env.num_envs

    def reset(self) -> FloatArray:
        """Reset all n robots with their current seeds; return the observation, (n, m), with m numbers per robot."""
        return self.reset_to_seeds(self._episode_seeds)

    def reset_to_seeds(self, seeds: Sequence[int]) -> FloatArray:
        """Reset robot i with the seed `seeds[i]`, clear `action_log`, and return the observation.

        The observation, (n, m), has m numbers for each of the n robots.
        """
        self._episode_seeds = seeds
        self.action_log = []
        return self._with_privileged(*self.env.reset(seed=seeds))  # type: ignore[arg-type]  # the environments of this project accept one seed per robot

    def replay(self, seeds: Sequence[int], actions: Sequence[FloatArray]) -> tuple[FloatArray, BoolArray]:
        """Reset the robots with given seeds, and execute recorded actions, to restore the states of the robots.

        Args:
            seeds: Seed of each robot.
            actions: Recorded actions of all n robots, one array, (n, 12), per step.

        Returns:
            The last observation, (n, m), with m numbers per robot; and a mask, (n,), that is True for robots at the
            start of an episode.
        """
        observation = self.reset_to_seeds(seeds)
        finished = np.ones(self.num_envs, np.bool_)
        for each in actions:
            self.step_async(each)
            observation, _, finished, _ = self.step_wait()
        return observation, finished

    def step_async(self, actions: FloatArray) -> None:
        """Store the actions of all n robots, (n, 12), which `step_wait` then executes."""
        self._actions = actions
        if self._keep_actions:
            self.action_log.append(actions)

    def step_wait(self) -> tuple[FloatArray, FloatArray, BoolArray, list[dict[str, Any]]]:
        """Execute one step of all robots with the actions that `step_async` has stored.

        Returns:
            Observations, (n, m), with m numbers per robot; scaled rewards, (n,); True for robots that finished an
            episode, (n,); and a dictionary of infos for each robot, empty if the robot did not finish an episode.
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
        if self._reward_floor is not None:
            rewards = np.maximum(rewards, self._reward_floor)
        scaled_rewards = (self._reward_scale * rewards).astype(np.float32)
        return self._with_privileged(observation, infos), scaled_rewards, finished, robot_infos

    def _with_privileged(self, observation: FloatArray, infos: dict[str, Any]) -> FloatArray:
        """Append the columns `infos["privileged"]` to `observation`, (n, m), if `privileged` is not 0.

        The observation has m numbers for each of the n robots. Only the value network receives the appended columns.
        """
        return np.concatenate((observation, infos["privileged"]), axis=1) if self.privileged else observation

    def close(self) -> None:
        """Close the wrapped vector environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return the value of an attribute of this environment, repeated for each robot in `indices`.

        SB3 calls the method. All robots have the same value.

        Args:
            attr_name: Name of the attribute.
            indices: Indices of robots; None for all.

        Returns:
            One value per robot.
        """
        value = None if attr_name == "render_mode" else getattr(self, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise NotImplementedError, because there is no separate object for a single robot.

        Args:
            attr_name: Not used.
            value: Not used.
            indices: Not used.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError(NO_SINGLE_ROBOTS)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Raise NotImplementedError, because there is no separate object for a single robot.

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
        """Return False for each robot in `indices`, because single robots have no wrapper of `wrapper_class`."""
        return [False for _ in self._get_indices(indices)]
