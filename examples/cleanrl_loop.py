"""PPO in one loop on the native batch, as CleanRL writes it: `python examples/cleanrl_loop.py`, with the extra `train`.

The batch restarts a robot that has ended with the step after, whose action counts for nothing: `live` leaves it out.
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
    """Train, and print what a step earns, every tenth update."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # more make networks of this size slower
    batch = gym.make_vec("quad_env:SimpleQuad-v0", num_envs=robots, scenario="flat=1", config=TASK)
    env = VectorHomePoseActions(batch, authority=0.5)
    actor, critic = (nn.Sequential(nn.Linear(48, 64), nn.Tanh(), nn.Linear(64, width)) for width in (12, 1))
    log_std = nn.Parameter(torch.full((12,), -2.0))
    adam = torch.optim.Adam([*actor.parameters(), *critic.parameters(), log_std], lr=1e-3)
    seen, ended = torch.as_tensor(env.reset(seed=seed)[0]), torch.zeros(robots, dtype=torch.bool)
    for update in range(max(1, steps // (robots * horizon))):
        rollout = []
        for _ in range(horizon):
            action = torch.distributions.Normal(actor(seen), log_std.exp()).sample()
            following, reward, fell, cut, _ = env.step(action.numpy())
            live, ended = ~ended, torch.as_tensor(fell | cut)
            rollout.append((seen, action, torch.as_tensor(reward).float(), torch.as_tensor(fell), ended, live))
            seen = torch.as_tensor(following)
        observed, actions, rewards, falls, ends, lives = map(torch.stack, zip(*rollout, strict=True))
        values = critic(torch.cat((observed, seen[None]))).squeeze(-1).detach()
        advantage, later = torch.zeros_like(rewards), torch.zeros(robots)
        for step in reversed(range(horizon)):
            surprise = rewards[step] + 0.99 * ~falls[step] * values[step + 1] - values[step]
            advantage[step] = later = surprise + 0.99 * 0.95 * ~ends[step] * later
        gain = (advantage - advantage[lives].mean()) / (advantage[lives].std() + 1e-8)
        before = None
        for _ in range(5):
            density = torch.distributions.Normal(actor(observed), log_std.exp()).log_prob(actions).sum(-1)
            before = density.detach() if before is None else before
            ratio = (density - before).exp()
            gained = torch.minimum(ratio * gain, ratio.clamp(0.8, 1.2) * gain)
            error = critic(observed).squeeze(-1) - advantage - values[:-1]
            loss = (0.5 * error.square() - gained)[lives].mean()
            adam.zero_grad()
            loss.backward()
            adam.step()
        if update % 10 == 0:
            print(f"{(update + 1) * robots * horizon:>9,} steps  reward {rewards[lives].mean():.5f} a step", flush=True)
    env.close()


if __name__ == "__main__":
    tyro.cli(main)
