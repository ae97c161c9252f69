"""Copies and pickles of environments step to the same bits as the original."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import quad_env
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD

MAKERS: dict[str, Callable[[], Any]] = {
    "single": lambda: SimpleQuadEnv("push", sensors="typical"),
    "wrapped": lambda: gym.make("SimpleQuad-v0", scenario="payload", actuator="motor"),
    "batch": lambda: gym.make_vec("SimpleQuad-v0", num_envs=2, scenario="rough"),
    "batch by position": lambda: SimpleQuadVectorEnv(2, "noise", 1, "SAME_STEP", config=quad_env.TaskConfig(50.0)),
}


def rollout(env: Any, seed: int | None) -> list[bytes]:
    observation, _ = env.reset(seed=seed)
    action = np.broadcast_to(SIMPLE_QUAD.home_pose.astype(np.float32), env.action_space.shape)
    out = [observation.tobytes()]
    for _ in range(5):
        observation, reward, *_ = env.step(action)
        out.append(observation.tobytes() + np.asarray(reward).tobytes())
    return out


@pytest.mark.parametrize("name", MAKERS)
def test_a_copy_steps_to_the_same_bits_and_goes_on_with_the_next_episode(name: str) -> None:
    env = MAKERS[name]()
    first = rollout(env, 5)
    twin = copy.deepcopy(env) if name == "batch" else pickle.loads(pickle.dumps(env))
    with pytest.raises(ResetNeeded):
        twin.step(np.broadcast_to(SIMPLE_QUAD.home_pose, env.action_space.shape))
    second = rollout(env, None)
    assert second != first
    assert rollout(twin, None) == second
    assert rollout(twin, 5) == first
    assert twin.spec == env.spec
