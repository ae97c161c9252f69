"""rsl_rl's PPO on the native batch, exported as an ONNX file: `python examples/rsl_rl_batch.py`.

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


class Robots(VecEnv):  # type: ignore[misc]
    """The native batch in rsl_rl's protocol: tensors, and finished robots restarted in the same step."""

    def __init__(self, num_envs: int) -> None:
        self.num_envs, self.num_actions, self.max_episode_length = num_envs, 12, quad_env.MAX_EPISODE_STEPS
        self.device, self.cfg = "cpu", dict[str, Any]()
        self.vec = quad_env.VectorHomePoseActions(
            gym.make_vec(quad_env.ENV_ID, num_envs=num_envs, autoreset_mode="SAME_STEP"), authority=0.5
        )
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long)
        self.observation, _ = self.vec.reset(seed=0)

    def get_observations(self) -> TensorDict:
        """What the robots see, (n, 48)."""
        return TensorDict({"policy": torch.as_tensor(self.observation)}, batch_size=[self.num_envs])

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Move the robots by one control period."""
        self.observation, reward, terminated, truncated, _ = self.vec.step(actions.numpy())
        done = torch.as_tensor(terminated | truncated)
        self.episode_length_buf = torch.where(done, 0, self.episode_length_buf + 1)
        extras = {"time_outs": torch.as_tensor(truncated & ~terminated)}
        return self.get_observations(), torch.as_tensor(reward, dtype=torch.float32), done, extras


def main(iterations: int = 200, robots: int = 256, out: Path = Path("runs/rsl_rl")) -> None:
    """Train, and export: a network from what a robot sees to its joint targets, rad."""
    torch.set_num_threads(1)  # more make networks of this size slower
    env, network = Robots(robots), {"class_name": "MLPModel", "hidden_dims": [128, 128], "obs_normalization": True}
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
    space, head = quad_env.HomePoseSpace(quad_env.SIMPLE_QUAD, authority=0.5), nn.Linear(12, 12)
    head.weight.data, head.bias.data = torch.tensor(space.authority).diag(), torch.tensor(space.home_pose)
    policy = nn.Sequential(runner.get_inference_policy().as_onnx(verbose=False), nn.Hardtanh(), head).eval()
    torch.onnx.export(policy, (torch.zeros(1, 48),), out / "policy.onnx", external_data=False)
    print(f"saved {out / 'policy.onnx'} after {iterations * 24 * robots} steps")


if __name__ == "__main__":
    tyro.cli(main)
