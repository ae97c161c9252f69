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
        env: what is trained on.
        seeds: one for each robot; every `reset` uses them, until `begin` gives others.
        reward_scale: factor on the rewards that the learner gets.
        privileged: append what only the value network may see, `infos["privileged"]`, to the observations.
        keep_actions: keep all actions since the start of the robots in `taken`, from which a run can be resumed. Their
            memory grows with every step until `begin`.
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
        """Last numbers of an observation, which only the value network may see."""
        space = Box(-np.inf, np.inf, (seen + self.privileged,), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)
        self.env = env
        self._episode_seeds = seeds
        self._reward_scale = reward_scale
        self._keep_actions = keep_actions
        self.action_log: list[FloatArray] = []
        """Actions since the start of the robots, each (n, k); empty unless they are kept."""
        self._no_infos: list[dict[str, Any]] = [{}] * env.num_envs

    def reset(self) -> FloatArray:
        """Start every robot's first episode; shape (n, m)."""
        return self.reset_to_seeds(self._episode_seeds)

    def reset_to_seeds(self, seeds: Sequence[int]) -> FloatArray:
        """Start every robot's first episode of other seeds, one a robot; shape (n, m)."""
        self._episode_seeds, self.action_log = seeds, []
        return self._with_privileged(*self.env.reset(seed=seeds))  # type: ignore[arg-type]  # our batches take one each

    def replay(self, seeds: Sequence[int], actions: Sequence[FloatArray]) -> tuple[FloatArray, BoolArray]:
        """Start with those seeds and repeat those actions; the last observation, (n, m), and new episodes, (n,)."""
        observation, finished = self.reset_to_seeds(seeds), np.ones(self.num_envs, np.bool_)
        for each in actions:
            self.step_async(each)
            observation, _, finished, _ = self.step_wait()
        return observation, finished

    def step_async(self, actions: FloatArray) -> None:
        """Take the actions, (n, k)."""
        self._actions = actions
        if self._keep_actions:
            self.action_log.append(actions)

    def step_wait(self) -> tuple[FloatArray, FloatArray, BoolArray, list[dict[str, Any]]]:
        """Move the robots; features, rewards, ends of episodes, and infos of the robots that ended one."""
        observation, rewards, terminated, truncated, infos = self.env.step(self._actions)
        finished = terminated | truncated
        ends = self._no_infos.copy()
        final = (
            self._with_privileged(infos["final_obs"], infos.get("final_info", {})) if finished.any() else observation
        )
        for i in np.flatnonzero(finished):
            ends[i] = {
                "terminal_observation": final[i],
                "TimeLimit.truncated": not terminated[i],
            }
            if "episode" in infos:
                ends[i]["episode"] = {"r": float(infos["episode"]["r"][i]), "l": int(infos["episode"]["l"][i])}
        return (
            self._with_privileged(observation, infos),
            (self._reward_scale * rewards).astype(np.float32),
            finished,
            ends,
        )

    def _with_privileged(self, observation: FloatArray, infos: dict[str, Any]) -> FloatArray:
        return np.concatenate((observation, infos["privileged"]), axis=1) if self.privileged else observation

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """One value a robot; the robots share all attributes."""
        value = None if attr_name == "render_mode" else getattr(self, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused."""
        raise NotImplementedError(NO_SINGLE_ROBOTS)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Refused."""
        raise NotImplementedError(NO_SINGLE_ROBOTS)

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """False: there are no single environments."""
        return [False for _ in self._get_indices(indices)]
