"""Stable-Baselines3's PPO on the native batch, the README's block with options: `python examples/sb3_batch.py`.

Needs `pip install -e ".[train]"`. A robot walks after 6 million steps, the default. `TrainingVecEnv` adapts the batch;
`python -m evaluate --trust --policies FILE stand --scenarios flat=1` evaluates the model.
"""

from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
import tyro
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3 import PPO

from quad_env import RewardWeights, TaskConfig, VectorHomePoseActions
from train.sb3.vec_env import TrainingVecEnv

REWARDS = RewardWeights(linear_velocity_error=-0.6, yaw_rate_error=-0.3, foot_air_time=10.0, fall=-5.0)
"""Reward weights with a slope far from the command, where the default rewards are flat."""
TASK = TaskConfig(timestep=0.005, solver_iterations=4, reward_weights=REWARDS)
"""Task with coarse and fast physics; evaluations use the robot's own physics."""


def learning_rate(remaining: float) -> float:
    """Return the learning rate at a remaining share of the run, (0, 1]."""
    return 1e-3 * max(remaining, 0.05)


def main(steps: int = 6_000_000, robots: int = 256, seed: int = 0, out: Path = Path("runs/sb3_batch.zip")) -> None:
    """Train and save a model, and print length and reward of the episodes.

    Args:
        steps: Steps of all robots together.
        robots: Number of robots.
        seed: Seed of networks, noise and episodes.
        out: File of the model.
    """
    torch.set_num_threads(1)  # more make networks of this size slower
    vec = gym.make_vec(
        "quad_env:SimpleQuad-v0", robots, autoreset_mode="SAME_STEP", scenario="flat=1", config=TASK, nthread=1
    )
    recorded = RecordEpisodeStatistics(VectorHomePoseActions(vec, authority=0.5))
    env = TrainingVecEnv(recorded, seeds=range(1000 * seed, 1000 * seed + robots), reward_scale=10.0)
    network = {"log_std_init": -2.0, "net_arch": [128, 128], "activation_fn": torch.nn.ELU}
    settings: dict[str, Any] = {
        "n_steps": 32,
        "batch_size": 8 * robots,
        "n_epochs": 5,
        "gamma": 0.98,
        "policy_kwargs": network,
    }
    model = PPO("MlpPolicy", env, learning_rate, **settings, seed=seed, device="cpu", verbose=1)
    model.learn(steps, log_interval=10)
    out.parent.mkdir(parents=True, exist_ok=True)
    model.save(out)
    print(f"saved {out} after {model.num_timesteps} steps")
    env.close()


if __name__ == "__main__":
    tyro.cli(main)
