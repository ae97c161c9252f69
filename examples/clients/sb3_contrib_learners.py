"""TQC, CrossQ and RecurrentPPO of sb3-contrib on single robots: `python examples/clients/sb3_contrib_learners.py`."""

import gymnasium as gym
import torch
import tyro
from sb3_contrib import TQC, CrossQ, RecurrentPPO

import quad_env


def main(steps: int = 10_000) -> None:
    """Train each on the joint targets as they are; off-policy learners rescale these by themselves."""
    torch.set_num_threads(1)  # more make networks of this size slower
    late = {"learning_starts": 3 * steps // 4, "policy_kwargs": {"net_arch": [64, 64]}}
    for learner, policy, settings in (
        (TQC, "MlpPolicy", late),
        (CrossQ, "MlpPolicy", late),
        (RecurrentPPO, "MlpLstmPolicy", {"n_steps": 128, "n_epochs": 1}),
    ):
        model = learner(policy, gym.make(quad_env.ENV_ID, max_episode_steps=100), device="cpu", seed=0, **settings)
        model.learn(steps)
        earned = [each["r"] for each in model.ep_info_buffer or ()]
        print(f"{learner.__name__}: {model.num_timesteps} steps, {len(earned)} episodes earned {sum(earned):.3f}")


if __name__ == "__main__":
    tyro.cli(main)
