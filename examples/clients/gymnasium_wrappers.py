"""Gymnasium's wrappers on one robot and on the native batch, and its own vector environments.

`python examples/clients/gymnasium_wrappers.py`
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from gymnasium import wrappers
from gymnasium.wrappers import vector

ENV_ID = "quad_env:SimpleQuad-v0"
LIMIT = np.ones(12, np.float32)
"""Limit of rescaled actions."""
COMMON_WRAPPERS = ("RecordEpisodeStatistics", "ClipAction", "NormalizeObservation", "NormalizeReward")
SINGLE_WRAPPERS: tuple[Callable[[Any], Any], ...] = (
    wrappers.TimeAwareObservation,
    lambda env: wrappers.RescaleAction(env, -LIMIT, LIMIT),
    lambda env: wrappers.FrameStackObservation(env, 3),
    lambda env: wrappers.DelayObservation(env, 2),
)
VECTOR_WRAPPERS: tuple[Callable[[Any], Any], ...] = (
    vector.DictInfoToList,
    lambda env: vector.RescaleAction(env, -LIMIT, LIMIT),
)


def step_randomly(env: Any, steps: int) -> float:
    """Return the sum of the rewards of random actions in `env` over `steps` steps."""
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
    """Step every wrapper, and three robots in processes, in this process and in the batch; their rewards agree.

    Args:
        steps: Steps of each.
    """
    for wrapper in (*SINGLE_WRAPPERS, *(getattr(wrappers, name) for name in COMMON_WRAPPERS)):
        env = wrapper(gym.make(ENV_ID))
        print(f"one robot, {type(env).__name__}: {step_randomly(env, steps):.3f}")
    for wrapper in (*VECTOR_WRAPPERS, *(getattr(vector, name) for name in COMMON_WRAPPERS)):
        vector_env = wrapper(gym.make_vec(ENV_ID, num_envs=3))
        print(f"three robots, {type(vector_env).__name__}: {step_randomly(vector_env, steps):.3f}")
    for mode in ("async", "sync", "vector_entry_point"):
        vector_env = gym.make_vec(ENV_ID, num_envs=3, vectorization_mode=mode)
        print(f"three robots, {mode}: {step_randomly(vector_env, steps)}")


if __name__ == "__main__":
    tyro.cli(main)
