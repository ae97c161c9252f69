"""A reward of your own on the batch: `python examples/batch_reward.py`.

A wrapper computes the reward from the readings in the infos; a learner takes the wrapped batch. The robots of this file
walk with a policy on two scenarios, and the rewards of each scenario are printed.
"""

from typing import Any

import gymnasium as gym
import numpy as np
import tyro

import policies
import quad_env


# The base class has no type parameters, because Gymnasium 1.2 does not accept any.
class FootClearance(gym.vector.VectorWrapper):
    """Adds a penalty on swing feet that are lower than a height.

    Args:
        env: Batch of n robots, made with `readings=True`.
        height: Height of a swing foot above the ground without penalty, m.
        weight: Reward for each foot and m of missing height, per second.
    """

    def __init__(self, env: Any, height: float = 0.08, weight: float = -2.0) -> None:
        super().__init__(env)
        self.height = height
        self.step_weight = weight * env.unwrapped.dt

    def step(self, actions: Any) -> Any:
        """Step the robots, and add the penalty to their rewards, (n,)."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        shortfall = np.maximum(0.0, self.height - infos["foot_height"])  # (n, 4), m
        is_swinging = ~infos["foot_contact"]
        infos["reward_clearance"] = self.step_weight * (is_swinging * shortfall).sum(axis=1)
        return observations, rewards + infos["reward_clearance"], terminated, truncated, infos


def main(policy: str = "trot", robots: int = 16, steps: int = 300) -> None:
    """Walk with a policy, and print the mean rewards of each scenario.

    Args:
        policy: Name of the policy.
        robots: Number of robots, half of them on each scenario.
        steps: Number of control steps.
    """
    scenarios = ["flat", "rough"]
    vec = FootClearance(gym.make_vec(quad_env.ENV_ID, num_envs=robots, scenario=scenarios, readings=True))
    walker = policies.make(policy)
    walker.reset(num_envs=robots)
    observation, _ = vec.reset(seed=0, options={"command": (0.5, 0.0, 0.0)})
    rewards = []
    penalties = []
    for _ in range(steps):
        observation, reward, _, _, infos = vec.step(walker.act(observation))
        rewards.append(reward)
        penalties.append(infos["reward_clearance"])
    mean_reward = np.reshape(np.mean(rewards, axis=0), (len(scenarios), -1)).mean(axis=1)
    mean_penalty = np.reshape(np.mean(penalties, axis=0), (len(scenarios), -1)).mean(axis=1)
    for name, total, penalty in zip(scenarios, mean_reward, mean_penalty, strict=True):
        print(f"{name}: reward {total:.4f} a step, {penalty:.4f} of it for clearance")


if __name__ == "__main__":
    tyro.cli(main)
