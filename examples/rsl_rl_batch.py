"""PPO of rsl_rl on the native batch, exported as an ONNX file: `python examples/rsl_rl_batch.py`.

Needs `pip install -e ".[clients]"`. `python -m evaluate --policies runs/rsl_rl/policy.onnx trot` evaluates it.
"""

from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
import tyro
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict
from torch import nn

import quad_env


class BatchVecEnv(VecEnv):  # type: ignore[misc]
    """Native batch in rsl_rl's protocol: tensors, and finished robots restarted in the same step."""

    def __init__(self, num_envs: int) -> None:
        self.num_envs = num_envs
        self.num_actions = 12
        self.max_episode_length = quad_env.MAX_EPISODE_STEPS
        self.device = "cpu"
        self.cfg: dict[str, Any] = {}
        self.vec = quad_env.VectorHomePoseActions(
            gym.make_vec(quad_env.ENV_ID, num_envs=num_envs, autoreset_mode="SAME_STEP"), authority=0.5
        )
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long)
        self.observation, _ = self.vec.reset(seed=0)

    def get_observations(self) -> TensorDict:
        """Return the observations of all robots, (n, 48)."""
        return TensorDict({"policy": torch.as_tensor(self.observation)}, batch_size=[self.num_envs])

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Step all robots by one control period with actions as shares of the authority, (n, 12)."""
        self.observation, reward, terminated, truncated, _ = self.vec.step(actions.numpy())
        done = torch.as_tensor(terminated | truncated)
        self.episode_length_buf = torch.where(done, 0, self.episode_length_buf + 1)
        extras = {"time_outs": torch.as_tensor(truncated & ~terminated)}
        return self.get_observations(), torch.as_tensor(reward, dtype=torch.float32), done, extras


def main(iterations: int = 200, robots: int = 256, out: Path = Path("runs/rsl_rl")) -> None:
    """Train, and export a network from the observation to the joint targets, rad.

    Args:
        iterations: Updates of the policy.
        robots: Number of robots.
        out: Folder of the network and of the training.
    """
    torch.set_num_threads(1)  # more make networks of this size slower
    env = BatchVecEnv(robots)
    network = {"class_name": "MLPModel", "hidden_dims": [128, 128], "obs_normalization": True}
    noise = {"class_name": "GaussianDistribution", "init_std": 0.4}
    settings = {
        "algorithm": {"class_name": "PPO"},
        "actor": network | {"distribution_cfg": noise},
        "critic": dict(network),
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "num_steps_per_env": 24,
        "save_interval": 1000,
    }
    runner = OnPolicyRunner(env, settings, log_dir=str(out))
    runner.learn(iterations)
    space = quad_env.HomePoseSpace(quad_env.SIMPLE_QUAD, authority=0.5)
    to_targets = nn.Linear(12, 12)
    to_targets.weight.data = torch.tensor(space.authority).diag()
    to_targets.bias.data = torch.tensor(space.home_pose)
    policy = nn.Sequential(runner.get_inference_policy().as_onnx(verbose=False), nn.Hardtanh(), to_targets).eval()
    torch.onnx.export(policy, (torch.zeros(1, 48),), out / "policy.onnx", external_data=False)
    print(f"saved {out / 'policy.onnx'} after {iterations * 24 * robots} steps")


if __name__ == "__main__":
    tyro.cli(main)
