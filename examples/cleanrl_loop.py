"""PPO in one loop on the native batch, as CleanRL writes it: `python examples/cleanrl_loop.py`, with the extra `train`.

The batch restarts an ended robot in the next step and ignores its action there; `is_valid` masks these steps.
"""

import gymnasium as gym
import torch
import tyro
from torch import nn

from quad_env import RewardWeights, TaskConfig, VectorHomePoseActions

REWARDS = RewardWeights(linear_velocity_error=-0.6, yaw_rate_error=-0.3, foot_air_time=10.0, fall=-5.0)
"""Reward weights with a slope far from the command, where the default rewards are flat."""
TASK = TaskConfig(timestep=0.005, solver_iterations=4, reward_weights=REWARDS)
"""Task with coarse and fast physics; evaluations use the robot's own physics."""


def main(steps: int = 500_000, robots: int = 64, horizon: int = 32, seed: int = 0) -> None:
    """Train, and print the mean reward of a step every tenth update.

    Args:
        steps: Steps of all robots together.
        robots: Number of robots.
        horizon: Steps of each robot between two updates.
        seed: Seed of networks, noise and episodes.
    """
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # more make networks of this size slower
    batch = gym.make_vec("quad_env:SimpleQuad-v0", num_envs=robots, scenario="flat=1", config=TASK)
    env = VectorHomePoseActions(batch, authority=0.5)
    actor, critic = (nn.Sequential(nn.Linear(48, 64), nn.Tanh(), nn.Linear(64, width)) for width in (12, 1))
    log_std = nn.Parameter(torch.full((12,), -2.0))
    adam = torch.optim.Adam([*actor.parameters(), *critic.parameters(), log_std], lr=1e-3)
    observation = torch.as_tensor(env.reset(seed=seed)[0])
    has_ended = torch.zeros(robots, dtype=torch.bool)
    for update in range(max(1, steps // (robots * horizon))):
        rollout = []
        for _ in range(horizon):
            action = torch.distributions.Normal(actor(observation), log_std.exp()).sample()
            next_observation, reward, terminated, truncated, _ = env.step(action.numpy())
            is_valid = ~has_ended
            has_ended = torch.as_tensor(terminated | truncated)
            fell = torch.as_tensor(terminated)
            rollout.append((observation, action, torch.as_tensor(reward).float(), fell, has_ended, is_valid))
            observation = torch.as_tensor(next_observation)
        observations, actions, rewards, falls, ends, valid = map(torch.stack, zip(*rollout, strict=True))
        values = critic(torch.cat((observations, observation[None]))).squeeze(-1).detach()
        advantages = torch.zeros_like(rewards)
        next_advantage = torch.zeros(robots)
        for step in reversed(range(horizon)):
            td_error = rewards[step] + 0.99 * ~falls[step] * values[step + 1] - values[step]
            next_advantage = td_error + 0.99 * 0.95 * ~ends[step] * next_advantage
            advantages[step] = next_advantage
        normalized = (advantages - advantages[valid].mean()) / (advantages[valid].std() + 1e-8)
        old_log_prob = None
        for _ in range(5):
            log_prob = torch.distributions.Normal(actor(observations), log_std.exp()).log_prob(actions).sum(-1)
            old_log_prob = log_prob.detach() if old_log_prob is None else old_log_prob
            ratio = (log_prob - old_log_prob).exp()
            objective = torch.minimum(ratio * normalized, ratio.clamp(0.8, 1.2) * normalized)
            value_error = critic(observations).squeeze(-1) - advantages - values[:-1]
            loss = (0.5 * value_error.square() - objective)[valid].mean()
            adam.zero_grad()
            loss.backward()
            adam.step()
        if update % 10 == 0:
            print(f"{(update + 1) * robots * horizon:>9,} steps  reward {rewards[valid].mean():.5f} a step", flush=True)
    env.close()


if __name__ == "__main__":
    tyro.cli(main)
