"""Gymnasium's wrappers on one robot and on the native batch, and its own vector environments compared with the batch.

python examples/clients/gymnasium_wrappers.py
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from gymnasium import wrappers
from gymnasium.wrappers import vector

NAME, LIMIT = "quad_env:SimpleQuad-v0", np.ones(12, np.float32)
OF_BOTH = ("RecordEpisodeStatistics", "ClipAction", "NormalizeObservation", "NormalizeReward")
OF_ONE: tuple[Callable[[Any], Any], ...] = (
    wrappers.TimeAwareObservation,
    lambda env: wrappers.RescaleAction(env, -LIMIT, LIMIT),
    lambda env: wrappers.FrameStackObservation(env, 3),
    lambda env: wrappers.DelayObservation(env, 2),
)
OF_MANY: tuple[Callable[[Any], Any], ...] = (
    vector.DictInfoToList,
    lambda env: vector.RescaleAction(env, -LIMIT, LIMIT),
)


def walk(env: Any, steps: int) -> float:
    """Rewards of random actions, after as many steps."""
    env.reset(seed=0)
    env.action_space.seed(0)
    total = 0.0
    for _ in range(steps):
        _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        total += float(np.mean(reward))
        if isinstance(env, gym.Env) and (terminated or truncated):
            env.reset()
    env.close()
    return total


def main(steps: int = 200) -> None:
    """Step each, and three robots in other processes, in this one, and in the native batch, whose rewards agree."""
    for wrapper in (*OF_ONE, *(getattr(wrappers, name) for name in OF_BOTH)):
        print(f"one robot, {type(env := wrapper(gym.make(NAME))).__name__}: {walk(env, steps):.3f}")
    for wrapper in (*OF_MANY, *(getattr(vector, name) for name in OF_BOTH)):
        print(f"three robots, {type(env := wrapper(gym.make_vec(NAME, num_envs=3))).__name__}: {walk(env, steps):.3f}")
    for mode in ("async", "sync", "vector_entry_point"):
        print(f"three robots, {mode}: {walk(gym.make_vec(NAME, num_envs=3, vectorization_mode=mode), steps)}")


if __name__ == "__main__":
    tyro.cli(main)
