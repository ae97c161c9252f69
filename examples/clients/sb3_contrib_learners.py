"""TQC, CrossQ and RecurrentPPO of sb3-contrib on single robots: `python examples/clients/sb3_contrib_learners.py`."""

import gymnasium as gym
import torch
import tyro
from sb3_contrib import TQC, CrossQ, RecurrentPPO

import quad_env


def main(steps: int = 10_000) -> None:
    """Train each learner on joint targets, rad; off-policy learners rescale them themselves.

    Args:
        steps: Steps of each learner.
    """
    torch.set_num_threads(1)  # more make networks of this size slower
    off_policy = {"learning_starts": 3 * steps // 4, "policy_kwargs": {"net_arch": [64, 64]}}
    for learner, policy, settings in (
        (TQC, "MlpPolicy", off_policy),
        (CrossQ, "MlpPolicy", off_policy),
        (RecurrentPPO, "MlpLstmPolicy", {"n_steps": 128, "n_epochs": 1}),
    ):
        model = learner(policy, gym.make(quad_env.ENV_ID, max_episode_steps=100), device="cpu", seed=0, **settings)
        model.learn(steps)
        returns = [episode["r"] for episode in model.ep_info_buffer or ()]
        print(f"{learner.__name__}: {model.num_timesteps} steps, {len(returns)} episodes earned {sum(returns):.3f}")


if __name__ == "__main__":
    tyro.cli(main)
