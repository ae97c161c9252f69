"""Stable-Baselines3's PPO on single environments, then evaluated: `python examples/sb3_home_pose.py`.

Needs `pip install -e ".[train]"`. Plain PPO explores about 0 at unit size: a robot cannot stand with these joint angles
in rad. It can with actions as shares of 0.5 rad about the home pose. The saved model contains the meaning of its
actions. This example shows SB3's own wrappers: 200,000 steps do not make a robot walk. `sb3_batch.py` makes one walk.
"""

from pathlib import Path

import gymnasium as gym
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from evaluate.__main__ import main as evaluate
from quad_env import HomePoseActions, RewardWeights, TaskConfig

REWARDS = RewardWeights(linear_velocity_error=-0.6, yaw_rate_error=-0.3, foot_air_time=10.0, fall=-5.0)
"""Reward weights with a slope far from the command, where the default rewards are flat."""


def make_robot() -> HomePoseActions:
    """Return a robot on flat ground, commands up to 1 m/s, with actions as shares of 0.5 rad."""
    task = TaskConfig(reward_weights=REWARDS)
    return HomePoseActions(gym.make("quad_env:SimpleQuad-v0", scenario="flat=1", config=task), authority=0.5)


def main(steps: int = 200_000, out: Path = Path("runs/sb3_home_pose.zip"), episodes: int = 8) -> int:
    """Train and save a model, and compare it with the standing robot, which is action 0.

    Args:
        steps: Steps of all robots together.
        out: File of the model.
        episodes: Episodes of the comparison.

    Returns:
        Exit code.
    """
    torch.set_num_threads(1)  # more make networks of this size slower
    env = make_vec_env(make_robot, n_envs=4, seed=0)
    model = PPO(
        "MlpPolicy", env, n_steps=256, batch_size=256, seed=0, device="cpu", policy_kwargs={"log_std_init": -2.0}
    )
    model.learn(steps)
    out.parent.mkdir(parents=True, exist_ok=True)
    model.save(out)
    print(f"saved {out} after {model.num_timesteps} steps")
    arguments = ["--policies", str(out), "stand", "--trust", "--scenarios", "flat=1", "--episodes", str(episodes)]
    return evaluate([*arguments, "--out", str(out.with_suffix(""))])


if __name__ == "__main__":
    raise SystemExit(tyro.cli(main))
