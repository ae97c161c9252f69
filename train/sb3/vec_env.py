"""The native batches as Stable-Baselines3 sees them: features in, corrections out, the base policy inside."""

import copy
import dataclasses
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices

from policies.base import GaitedPolicy, Policy
from policies.residual import compose, features
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.robot import NUM_JOINTS

FloatArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
REWARD = "reward_"
"""What the infos' keys of reward terms begin with."""


@dataclasses.dataclass
class Statistics:
    """Sums over the steps since the last look, for the progress display."""

    steps: int = 0
    velocity_error: float = 0.0
    """Planar velocity error in the heading frame, m/s, summed over steps."""
    yaw_rate_error: float = 0.0
    """rad/s, summed over steps."""
    reward_terms: dict[str, float] = dataclasses.field(default_factory=dict)
    episodes: int = 0
    falls: int = 0
    episode_return: float = 0.0
    """Summed over finished episodes."""

    def means(self) -> dict[str, float]:
        """Means a step (errors, reward terms) and a finished episode (return, falls); NaN where there was none."""
        step, episode = max(self.steps, 1), self.episodes or float("nan")
        return {
            "velocity_error": self.velocity_error / step,
            "yaw_rate_error": self.yaw_rate_error / step,
            "falls": self.falls / episode,
            "return": self.episode_return / episode,
            **{f"reward/{name}": total / step for name, total in self.reward_terms.items()},
        }


class TrainingEnv(VecEnv):
    """Several native batches side by side, one a scenario, as one SB3 vector environment.

    The batches must have been made with `AutoresetMode.DISABLED`: finished robots are reset here, after the features
    of their last observation have been taken with the base policy's clock still running.

    Observation: `policies.residual.features`, shape (n, m). Action: the correction in [-1, 1], shape (n, 12), which is
    held for `hold` control steps while the base goes on at every one: noise that lasts moves a robot, where noise that
    changes each 10 ms only shakes it.
    """

    def __init__(
        self,
        batches: Sequence[SimpleQuadVectorEnv],
        base: Policy,
        authority: FloatArray,
        seeds: NDArray[np.int64],
        first_episode_steps: NDArray[np.int64] | None = None,
        hold: int = 1,
        reward_scale: float = 1.0,
    ) -> None:
        """`seeds`: (n,), one a robot. `first_episode_steps`: (n,), where the first episodes are cut so that the robots
        are not all at the same point of their gait and episode; no cut when None. The learner gets the rewards times
        `reward_scale`; the statistics count them as they are."""
        self.batches = tuple(batches)
        self.base = base
        self.authority = authority
        self._robot_seeds = seeds
        self._first_episode_steps = first_episode_steps
        self._hold = hold
        self._reward_scale = reward_scale
        ends = np.cumsum([batch.num_envs for batch in batches])
        self._parts = [slice(int(end) - batch.num_envs, int(end)) for end, batch in zip(ends, batches, strict=True)]
        self.statistics = Statistics()
        n = int(ends[-1])
        self._start(n, self._reset_batches())
        space = spaces.Box(-np.inf, np.inf, self._features.shape[1:], np.float32)
        super().__init__(n, space, spaces.Box(-1.0, 1.0, (NUM_JOINTS,), np.float32))
        self._no_infos: list[dict[str, Any]] = [{}] * n

    def _reset_batches(self) -> FloatArray:
        observations = [
            batch.reset(seed=self._robot_seeds[part].tolist())[0]
            for batch, part in zip(self.batches, self._parts, strict=True)
        ]
        return np.concatenate(observations)

    def _start(self, n: int, observation: FloatArray) -> None:
        self._elapsed = np.zeros(n, np.int64)
        self._returns = np.zeros(n)
        self._first_episode = np.full(n, self._first_episode_steps is not None)
        self.base.reset(n)
        self._base_action, self._features = self._look(self.base, observation)

    def _look(self, base: Policy, observation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The base's actions (n, 12) on (n, k) observations, and the learner's features (n, m)."""
        action = base.act(observation)
        phase = base.phase if isinstance(base, GaitedPolicy) else None
        return action, features(observation, phase, action)

    def reset(self) -> FloatArray:
        """Start every robot's first episode; shape (n, m)."""
        self._start(self.num_envs, self._reset_batches())
        return self._features

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the corrections, (n, 12)."""
        self._correction = np.asarray(actions, np.float32)

    def step_wait(self) -> tuple[FloatArray, NDArray[np.float32], BoolArray, list[dict[str, Any]]]:
        """Move the robots; features, rewards, ends of episodes, and infos of the robots that ended one."""
        observation, rewards, terminated, truncated = self._move()
        for _ in range(self._hold - 1):
            # A robot that has finished stays frozen and earns nothing more.
            self._base_action, _ = self._look(self.base, observation)
            observation, more, terminated, truncated = self._move()
            rewards += more
        self._elapsed += self._hold
        self._returns += rewards
        if self._first_episode_steps is not None:
            truncated |= self._first_episode & (self._elapsed >= self._first_episode_steps)
        finished = terminated | truncated
        self._count_episodes(terminated, finished)
        infos = self._restart(observation, terminated, finished) if finished.any() else self._no_infos
        self._base_action, self._features = self._look(self.base, observation)
        return self._features, (self._reward_scale * rewards).astype(np.float32), finished, infos

    def _move(self) -> tuple[FloatArray, NDArray[np.float64], BoolArray, BoolArray]:
        """One control step of all batches: observations, rewards, terminated, truncated."""
        targets = compose(self._base_action, self._correction, self.authority)
        results = [b.step(targets[part]) for b, part in zip(self.batches, self._parts, strict=True)]
        for *_, infos in results:
            self._count_step(infos)
        observation, rewards, terminated, truncated = (
            np.concatenate([result[k] for result in results]) for k in range(4)
        )
        return observation, rewards, terminated, truncated

    def _restart(self, observation: FloatArray, terminated: BoolArray, finished: BoolArray) -> list[dict[str, Any]]:
        """Reset the finished robots, in `observation` too; gives the infos that SB3 bootstraps from."""
        # A copy of the base looks at the last observations, so that the running clocks tick once a step.
        _, final = self._look(copy.deepcopy(self.base), observation)
        infos = self._no_infos.copy()
        for i in np.flatnonzero(finished):
            infos[i] = {
                "terminal_observation": final[i],
                "TimeLimit.truncated": not terminated[i],
                "episode": {"r": float(self._returns[i]), "l": int(self._elapsed[i])},
            }
        for batch, part in zip(self.batches, self._parts, strict=True):
            if finished[part].any():
                observation[part] = batch.reset(options={"reset_mask": finished[part]})[0]
        self.base.reset_where(finished)
        self._elapsed[finished] = 0
        self._returns[finished] = 0.0
        self._first_episode[finished] = False
        return infos

    def _count_step(self, infos: dict[str, Any]) -> None:
        statistics = self.statistics
        error = infos["command"] - infos["heading_velocity"]
        statistics.steps += len(error)
        statistics.velocity_error += float(np.hypot(error[:, 0], error[:, 1]).sum())
        statistics.yaw_rate_error += float(np.abs(error[:, 2]).sum())
        for key, values in infos.items():
            if key.startswith(REWARD):
                name = key.removeprefix(REWARD)
                statistics.reward_terms[name] = statistics.reward_terms.get(name, 0.0) + float(values.sum())

    def _count_episodes(self, terminated: BoolArray, finished: BoolArray) -> None:
        statistics = self.statistics
        statistics.episodes += int(finished.sum())
        statistics.falls += int(terminated.sum())
        statistics.episode_return += float(self._returns[finished].sum())

    def take_statistics(self) -> Statistics:
        """What was counted since the last call."""
        taken, self.statistics = self.statistics, Statistics()
        return taken

    def close(self) -> None:
        """Close the batches."""
        for batch in self.batches:
            batch.close()

    def _indices(self, indices: VecEnvIndices) -> range | list[int]:
        return range(self.num_envs) if indices is None else list(self._get_indices(indices))

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """One value a robot; the robots share all attributes."""
        value = None if attr_name == "render_mode" else getattr(self, attr_name)
        return [value for _ in self._indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused: robots of a batch have no attributes of their own."""
        raise NotImplementedError("robots of a batch have no attributes of their own; make new batches instead")

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Refused: robots of a batch are no objects."""
        raise NotImplementedError("robots of a batch are no objects; call the methods of `batches`")

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Never wrapped: the batch is native."""
        return [False for _ in self._indices(indices)]
