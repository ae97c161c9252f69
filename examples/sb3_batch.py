"""Stable-Baselines3's PPO on the native batch: a hundred robots in one environment. `python examples/sb3_batch.py`.

Needs `pip install -e ".[train]"`. `TrainingVecEnv` adapts; `python -m evaluate --trust --policies FILE` evaluates it.
"""

from pathlib import Path

import gymnasium as gym
import torch
import tyro
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3 import PPO

from quad_env import VectorHomePoseActions
from train.sb3.vec_env import TrainingVecEnv


def main(steps: int = 500_000, robots: int = 100, out: Path = Path("runs/sb3_batch.zip")) -> None:
    """Train and save; prints how long episodes last and what they earn as it goes."""
    torch.set_num_threads(1)  # more make networks of this size slower
    vec = gym.make_vec("quad_env:SimpleQuad-v0", num_envs=robots, autoreset_mode="SAME_STEP")
    env = TrainingVecEnv(RecordEpisodeStatistics(VectorHomePoseActions(vec, authority=0.5)), seeds=range(robots))
    network = {"log_std_init": -1.0, "net_arch": [128, 128]}
    model = PPO(
        "MlpPolicy", env, n_steps=32, batch_size=8 * robots, seed=0, device="cpu", policy_kwargs=network, verbose=1
    )
    model.learn(steps, log_interval=10)
    out.parent.mkdir(parents=True, exist_ok=True)
    model.save(out)
    print(f"saved {out} after {model.num_timesteps} steps")
    env.close()


if __name__ == "__main__":
    tyro.cli(main)
