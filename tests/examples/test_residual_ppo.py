"""Another learner on the residual environment: PPO in one file learns and writes its files."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import policies
from evaluate.rollouts.rollout import run
from examples import residual_ppo
from examples.residual_ppo import GAMMA, LAMBDA, Learner, Rollout, advantages, collect, learn, main
from quad_env.seeding import episode_seeds
from train.residual_env import ResidualVectorEnv


class Aim(VectorEnv[Any, Any, Any]):
    """Vector environment that rewards actions near the observation: 16 robots, truncated episodes of ten steps."""

    num_envs = 16
    single_observation_space = Box(-1.0, 1.0, (2,), np.float32)
    single_action_space = Box(-1.0, 1.0, (2,), np.float32)
    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self) -> None:
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self._random, self._steps = np.random.default_rng(seed), 0
        return self._look(), {}

    def step(self, actions: Any) -> Any:
        reward = -np.square(actions - self._seen).sum(axis=1, dtype=np.float64)
        self._steps += 1
        cut = np.full(self.num_envs, self._steps % 10 == 0)
        return self._look(), reward, np.zeros_like(cut), cut, {"final_obs": np.ones((16, 2), np.float32)}

    def _look(self) -> Any:
        self._seen = self._random.uniform(-1.0, 1.0, (self.num_envs, 2)).astype(np.float32)
        return self._seen


def test_it_learns_what_it_is_paid_for(monkeypatch) -> None:
    monkeypatch.setattr(residual_ppo, "LOG_STD", -1.0)
    rewards: list[float] = []
    learner = learn(Aim(), 12 * residual_ppo.ROLLOUT_STEPS * 16, 0, [0], lambda _, reward: rewards.append(reward))
    assert len(rewards) == 12
    assert rewards[-1] > 0.5 * rewards[0]
    seen = torch.rand(1000, 2) * 2.0 - 1.0
    off = (learner.actor(seen) - seen).square().sum(1).mean()
    assert off < 0.1  # 2/3 at the start


def test_advantages_are_by_hand_those_of_two_robots_one_of_which_ends() -> None:
    rollout = Rollout(
        *(torch.zeros(0),) * 3,
        values=torch.tensor([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]),
        rewards=torch.tensor([[0.5, 0.5], [0.25, 0.25]]),
        ended=torch.tensor([[False, True], [False, False]]),
    )
    last = 0.25 + GAMMA * 3.0 - 2.0
    first = 0.5 + GAMMA * 2.0 - 1.0 + GAMMA * LAMBDA * last
    np.testing.assert_allclose(advantages(rollout), [[first, 0.5 - 1.0], [last, last]], rtol=1e-6)


def test_an_episode_that_is_cut_goes_on_in_the_critics_eyes() -> None:
    env, learner = Aim(), Learner(2, 2)
    torch.nn.init.constant_(learner.critic[-1].bias, 3.0)
    seen = torch.as_tensor(env.reset(seed=0)[0])
    rollout, _, reward = collect(env, learner, seen)
    plain = -residual_ppo.REWARD_SCALE * (rollout.actions - rollout.observations).square().sum(-1)
    more = (rollout.rewards - plain).mean(1)
    np.testing.assert_allclose(more[[9, 19]], GAMMA * 3.0, rtol=1e-4)
    np.testing.assert_allclose(more[[0, 8, 10, 23]], 0.0, atol=1e-4)
    assert reward == pytest.approx(float(plain.mean()) / residual_ppo.REWARD_SCALE, rel=1e-4)


def test_what_the_script_leaves_is_loaded_as_any_residual_and_walks_as_it_was_trained(
    tmp_path, monkeypatch, capsys
) -> None:
    found = {"success_rate": 0.5, "velocity_error": 0.1, "yaw_rate_error": 0.2, "fall_rate": 0.0}
    monkeypatch.setattr(residual_ppo, "validate", lambda *_: {"flat": found})
    assert main(["--steps", "3e2", "--envs", "8", "--threads", "1", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert f"{tmp_path}: 50% of 24 succeed, 0.100 m/s, 0.200 rad/s, falls 0%" in printed
    assert "trot: 50%" in printed
    policy = policies.load(tmp_path)
    assert any(weight.any() for weight in policy.network.weights[-1:])
    env = ResidualVectorEnv(
        gym.make_vec("quad_env:SimpleQuad-v0", num_envs=2, nthread=1, autoreset_mode="DISABLED"), policies.make("trot")
    )
    seeds = episode_seeds("user", 0, 2)
    seen, _ = env.reset(seed=seeds.tolist())
    walked = []
    for _ in range(20):
        seen, *_, infos = env.step(np.clip(policy.network(seen), -1.0, 1.0))
        walked.append(infos["heading_velocity"])
    recorded = run(policy, "flat", seeds, nthread=1, steps=20)
    np.testing.assert_array_equal(recorded.heading_velocity, np.array(walked, np.float32))
    assert np.abs(policy.correction).max() > 0.0
