"""Several batches of robots as one vector environment; each batch has its own scenario."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from typing import Any, Self

import numpy as np
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from quad_env.columns import Array, Mask
from quad_env.envs.arguments import parse_reset_options
from quad_env.envs.vector_env import Infos, Observation, SimpleQuadVectorEnv
from quad_env.seeding import assign_seeds
from quad_env.sensing.height_scan import HeightScan


class CombinedVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """Vector environment of all robots of several batches, in the order of the batches.

    Args:
        batches: Vector environments with the same robot, observation and autoreset mode.
        threads: Number of threads. Each thread steps one batch at a time. Results do not depend on this number.
    """

    batches: tuple[SimpleQuadVectorEnv, ...] = ()
    """Vector environment of each scenario; empty if the constructor failed."""
    _pool: ThreadPoolExecutor | None = None
    """Threads that step the batches; None if the batches are stepped in turn."""

    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """Create an environment and store the constructor arguments, which copies and pickles need."""
        env = super().__new__(cls)
        env._arguments = args, kwargs
        return env

    def __init__(self, batches: Sequence[SimpleQuadVectorEnv], threads: int = 1) -> None:
        ends = np.cumsum([batch.num_envs for batch in batches])
        self.batches = tuple(batches)
        self._parts = [slice(int(end) - batch.num_envs, int(end)) for end, batch in zip(ends, batches, strict=True)]
        """Rows of each batch in the arrays of all robots."""
        self._pool = ThreadPoolExecutor(threads, "robots") if threads > 1 else None
        self.num_envs = int(ends[-1])
        self.robot = batches[0].robot
        self.dt = batches[0].dt
        """Control period, s."""
        self.single_observation_space = batches[0].single_observation_space
        self.single_action_space = batches[0].single_action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.metadata = dict(batches[0].metadata)

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Infos]:
        """Start a new episode of every robot, or only where `options["reset_mask"]` is True.

        ValueError is raised, before any robot is reset, for an invalid seed or option.

        Args:
            seed: An integer; robot i then has the seed `seed` + i. Or a sequence with the seed of each robot.
            options: The options of `SimpleQuadVectorEnv.reset`, for all n robots.

        Returns:
            Observation of all n robots, (n, m), with m numbers per robot; and infos.
        """
        mask, fixed_command, severities = parse_reset_options(options, self.num_envs)
        seeds = None if seed is None else assign_seeds(seed, self.num_envs)
        if severities is not None:
            for batch, part in zip(self.batches, self._parts, strict=True):
                batch.moved_scenarios(severities[part], mask[part])
        super().reset(seed=int(seed) if isinstance(seed, int | np.integer) else None)
        results = []
        for batch, part in zip(self.batches, self._parts, strict=True):
            batch_options: dict[str, Any] = {"reset_mask": mask[part]}
            if fixed_command is not None:
                batch_options["command"] = fixed_command[part]
            if severities is not None:
                batch_options["severity"] = severities[part]
            results.append(batch.reset(seed=None if seeds is None else seeds[part], options=batch_options))
        infos = self._combine_infos([batch_infos for _, batch_infos in results])
        return np.concatenate([observation for observation, _ in results]), infos

    def step(self, actions: NDArray[np.floating[Any]]) -> tuple[Observation, Array, Mask, Mask, Infos]:
        """Simulate one control step of all robots.

        Args:
            actions: Joint targets, (n, 12), rad.

        Returns:
            obs: Observations after the step, (n, m).
            rewards: Reward of each robot, (n,).
            terminated: True for robots with a terminated episode, (n,).
            truncated: True for robots with a truncated episode, (n,).
            infos: Key -> array (n, ...).
        """
        batch_actions = [actions[part] for part in self._parts]
        map_batches: Callable[..., Iterable[Any]] = map if self._pool is None else self._pool.map
        results = list(map_batches(lambda batch, targets: batch.step(targets), self.batches, batch_actions))
        observation, rewards, terminated, truncated = map(np.concatenate, list(zip(*results, strict=True))[:4])
        return observation, rewards, terminated, truncated, self._combine_infos([result[4] for result in results])

    def true_observation(self, height_scan: HeightScan | None = None, with_scan_loss: bool = False) -> Observation:
        """Return the observation of the true present state of all robots, without noise and delay, (n, m).

        `SimpleQuadVectorEnv.true_observation` explains it.

        Args:
            height_scan: Grid of a height scan to append; None for no scan.
            with_scan_loss: True if grid points that the robots' own height scan does not show read -2 m.

        Returns:
            The observation.
        """
        return np.concatenate([batch.true_observation(height_scan, with_scan_loss) for batch in self.batches])

    def close_extras(self, **_: Any) -> None:
        """Close the batches, and stop the threads."""
        if self._pool is not None:
            self._pool.shutdown()
        for batch in self.batches:
            batch.close()

    def _combine_infos(self, infos: Sequence[Infos]) -> Infos:
        """Return the infos of all robots from the infos of each batch."""
        return combine_infos(infos, [batch.num_envs for batch in self.batches])


def combine_infos(infos: Sequence[Infos], counts: Sequence[int]) -> Infos:
    """Concatenate the infos of several batches along the robots.

    An info that a batch does not have is zero for its robots, and its mask `_<key>` is False.

    Args:
        infos: Infos of each batch, key -> array or dictionary of arrays.
        counts: Number of robots of each batch.

    Returns:
        Key -> array (n, ...), or dictionary of arrays, with all keys of all batches.
    """
    combined: Infos = {}
    for key in dict.fromkeys(chain.from_iterable(infos)):
        values = [batch_infos.get(key) for batch_infos in infos]
        example = next(value for value in values if value is not None)
        if isinstance(example, dict):
            combined[key] = combine_infos([value or {} for value in values], counts)
            continue
        combined[key] = np.concatenate(
            [
                np.zeros((count, *example.shape[1:]), example.dtype) if value is None else value
                for value, count in zip(values, counts, strict=True)
            ]
        )
    return combined
