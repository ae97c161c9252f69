"""PPO in one file of plain torch on the unchanged `train.residual_env.ResidualVectorEnv`.

    python examples/residual_ppo.py --steps 3e5 --out runs/residual-ppo
    python -m evaluate --policies trot runs/residual-ppo --scenarios flat

The clipped objective is from Schulman et al., 2017 (arXiv:1707.06347), the advantages are from Schulman et al., 2015
(arXiv:1506.02438). It has no curriculum, no privileged critic and no checkpoints: `python -m train` has these.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from torch import Tensor, nn

import policies
from evaluate.hardware import IDEAL
from evaluate.records.provenance import REPOSITORY, git_revision
from policies import bundle
from policies.network import Network
from policies.parameters import limits_of, parameter
from policies.residual import ResidualPolicy
from quad_env.cli.command_line import check_numbers, parse
from quad_env.cli.program import exit_code
from quad_env.files.writing import make_writable_folder
from quad_env.seeding import episode_seeds
from train.config import BaseName, ValidationConfig
from train.residual_env import ResidualVectorEnv
from train.validation import validate

ROLLOUT_STEPS = 24
"""Steps of each robot between two updates."""
EPOCHS = 5
"""Passes over a rollout."""
MINIBATCHES = 4
"""Gradient steps in a pass."""
GAMMA = 0.985
"""Discount of a step."""
LAMBDA = 0.95
"""Lambda of the generalised advantage estimate."""
LEARNING_RATE = 1e-3
"""Initial step size of Adam; it falls linearly to zero."""
CLIP = 0.2
"""Clip of the probability ratio."""
MAX_GRADIENT_NORM = 1.0
"""Norm to which gradients are clipped."""
REWARD_SCALE = 10.0
"""Factor on rewards; brings returns to about unit size."""
LOG_STD = -2.0
"""Initial logarithm of the exploration noise as a share of the authority."""
SCENARIO = "flat"
"""Scenario of training and validation."""
Report = Callable[[int, float], None]
"""Receives the steps so far and the mean reward of a step."""


@dataclass(frozen=True)
class ResidualOptions:
    """Options of the training."""

    steps: int = parameter(300_000, limits=(1, 10**12))
    """Steps of all robots together, rounded up to whole rollouts."""
    base: BaseName = "trot"
    """Base policy that the correction is added to."""
    seed: int = parameter(0, limits=(0, 2**32 - 1))
    """Seed of networks, noise and episodes."""
    out: Path = Path("runs/residual-ppo")
    """Folder of the bundle; an existing one is replaced."""
    envs: int = parameter(256, limits=(1, 65_536))
    """Number of robots."""
    threads: int = parameter(2, limits=(1, 256))
    """Threads of the simulation."""


class Learner(nn.Module):
    """Gaussian policy, its mean from the actor, and a critic; both are zero at first, so that the base walks."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.actor = _make_network(inputs, outputs)
        self.critic = _make_network(inputs, 1)
        self.log_std = nn.Parameter(torch.full((outputs,), LOG_STD))

    def act(self, observations: Tensor) -> Tensor:
        """Return random actions, (..., k), for observations, (..., m)."""
        mean: Tensor = self.actor(observations)
        return mean + self.log_std.exp() * torch.randn_like(mean)

    def log_prob(self, observations: Tensor, actions: Tensor) -> Tensor:
        """Return the logarithm of the actions' density without its constant, which cancels in ratios.

        Args:
            observations: (..., m).
            actions: (..., k).

        Returns:
            Logarithm of the density, (...).
        """
        normalized: Tensor = (actions - self.actor(observations)) / self.log_std.exp()
        return -(0.5 * normalized.square() + self.log_std).sum(-1)

    def value(self, observations: Tensor) -> Tensor:
        """Return the expected return, (...), for observations, (..., m)."""
        value: Tensor = self.critic(observations).squeeze(-1)
        return value

    def network(self) -> Network:
        """Return the mean of the policy as the NumPy network of a bundle."""
        layers = [layer for layer in self.actor if isinstance(layer, nn.Linear)]
        weights = tuple(np.ascontiguousarray(layer.weight.detach().numpy().T) for layer in layers)
        return Network(weights, tuple(layer.bias.detach().numpy().copy() for layer in layers))


def _make_network(inputs: int, outputs: int, hidden: int = 128) -> nn.Sequential:
    last = nn.Linear(hidden, outputs)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(inputs, hidden), nn.ELU(), nn.Linear(hidden, hidden), nn.ELU(), last)


class Rollout(NamedTuple):
    """Transitions of n robots in t steps, in the order of time; `collect` makes it."""

    observations: Tensor
    """(t, n, m)"""
    actions: Tensor
    """(t, n, k)"""
    log_prob: Tensor
    """Logarithm of the actions' density, (t, n)."""
    values: Tensor
    """Values of the critic for the observations, and for the one after the last step, (t + 1, n)."""
    rewards: Tensor
    """Scaled rewards, (t, n); the last of a truncated episode includes the value of its final observation."""
    ended: Tensor
    """True where an episode ended with the step, (t, n)."""


def learn(env: VectorEnv[Any, Any, Any], steps: int, seed: int, episodes: Sequence[int], report: Report) -> Learner:
    """Train a learner.

    Args:
        env: Environment with same-step autoreset.
        steps: Steps of all robots together, rounded up to whole rollouts.
        seed: Seed of networks and noise.
        episodes: Seeds of the environment's reset.
        report: Receives the progress after each update.

    Returns:
        The trained learner.
    """
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # more make networks of this size slower
    learner = Learner(env.single_observation_space.shape[0], env.single_action_space.shape[0])  # type: ignore[index]
    optimiser = torch.optim.Adam(learner.parameters(), lr=LEARNING_RATE)
    observation = torch.as_tensor(env.reset(seed=episodes)[0])  # type: ignore[arg-type]  # it takes one seed per robot
    num_updates = -(-steps // (ROLLOUT_STEPS * env.num_envs))
    for update_index in range(num_updates):
        optimiser.param_groups[0]["lr"] = LEARNING_RATE * (1.0 - update_index / num_updates)
        rollout, observation, reward = collect(env, learner, observation)
        update(learner, optimiser, rollout)
        report((update_index + 1) * ROLLOUT_STEPS * env.num_envs, reward)
    return learner


@torch.no_grad()
def collect(env: VectorEnv[Any, Any, Any], learner: Learner, observation: Tensor) -> tuple[Rollout, Tensor, float]:
    """Collect a rollout.

    Args:
        env: Environment with same-step autoreset.
        learner: Learner that acts.
        observation: Observations before the rollout, (n, m).

    Returns:
        rollout: The rollout.
        observation: Observations after it, (n, m).
        reward: Its mean reward.
    """
    steps = []
    total_reward = 0.0
    for _ in range(ROLLOUT_STEPS):
        action = learner.act(observation)
        next_observation, reward, terminated, truncated, infos = env.step(action.numpy())
        total_reward += reward.mean()
        scaled_reward = torch.as_tensor(REWARD_SCALE * reward, dtype=torch.float32)
        is_cut = truncated & ~terminated
        if is_cut.any():
            scaled_reward += GAMMA * torch.as_tensor(is_cut) * learner.value(torch.as_tensor(infos["final_obs"]))
        log_prob = learner.log_prob(observation, action)
        ended = torch.as_tensor(terminated | truncated)
        steps.append((observation, action, log_prob, learner.value(observation), scaled_reward, ended))
        observation = torch.as_tensor(next_observation)
    rollout = Rollout(*(torch.stack(column) for column in zip(*steps, strict=True)))
    values = torch.cat((rollout.values, learner.value(observation)[None]))
    return rollout._replace(values=values), observation, float(total_reward) / ROLLOUT_STEPS


def advantages(rollout: Rollout) -> Tensor:
    """Return the generalised advantage estimates, (t, n); nothing after the end of an episode counts."""
    continues = (~rollout.ended).float()
    td_error = rollout.rewards + GAMMA * continues * rollout.values[1:] - rollout.values[:-1]
    estimates = torch.empty_like(td_error)
    next_estimate = torch.zeros_like(td_error[0])
    for step in reversed(range(len(td_error))):
        next_estimate = td_error[step] + GAMMA * LAMBDA * continues[step] * next_estimate
        estimates[step] = next_estimate
    return estimates


def update(learner: Learner, optimiser: torch.optim.Optimizer, rollout: Rollout) -> None:
    """Update the networks on a rollout with the clipped objective.

    Args:
        learner: Learner that collected the rollout.
        optimiser: Optimiser of its parameters.
        rollout: The rollout.
    """
    estimates = advantages(rollout)
    returns = estimates + rollout.values[:-1]
    columns = (rollout.observations, rollout.actions, rollout.log_prob, estimates, returns)
    samples = [column.flatten(0, 1) for column in columns]
    for _ in range(EPOCHS):
        for indices in torch.randperm(len(samples[0])).chunk(MINIBATCHES):
            observations, actions, old_log_prob, advantage, target = (column[indices] for column in samples)
            advantage = (advantage - advantage.mean()) / (advantage.std(correction=0) + 1e-8)
            ratio = (learner.log_prob(observations, actions) - old_log_prob).exp()
            clipped_ratio = ratio.clamp(1.0 - CLIP, 1.0 + CLIP)
            objective = torch.minimum(ratio * advantage, clipped_ratio * advantage).mean()
            loss = 0.5 * (learner.value(observations) - target).square().mean() - objective
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(learner.parameters(), MAX_GRADIENT_NORM)
            optimiser.step()


def train(options: ResidualOptions, report: Report) -> None:
    """Train a residual and save it as a bundle.

    Args:
        options: Options of the training.
        report: Receives the progress after each update.
    """
    robots = gym.make_vec(
        "quad_env:SimpleQuad-v0",
        num_envs=options.envs,
        scenario=SCENARIO,
        nthread=options.threads,
        autoreset_mode="DISABLED",
    )
    env = ResidualVectorEnv(robots, policies.make(options.base))
    episodes = episode_seeds("training", options.seed, options.envs).tolist()
    learner = learn(env, options.steps, options.seed, episodes, report)
    env.close()
    policy = ResidualPolicy(policies.make(options.base), learner.network(), env.authority)
    training = asdict(options) | {"out": str(options.out), "learner": "examples/residual_ppo.py"}
    bundle.save(options.out, policy, training, git_revision(REPOSITORY) or "unknown")


def main(arguments: Sequence[str]) -> int:
    """Train, and evaluate the policy and its base; return the exit code."""
    options = parse(
        ResidualOptions, list(arguments), program="python examples/residual_ppo.py", description=__doc__ or ""
    )
    check_numbers(options, limits_of(options))
    make_writable_folder(options.out)
    train(options, lambda steps, reward: print(f"{steps:>10,} steps  reward {reward:.5f} a step", flush=True))
    validation = ValidationConfig(episodes=24, scenarios=(SCENARIO,))
    for name in (options.base, options.out):
        result = validate(policies.resolve(name), validation, options.threads, IDEAL)[SCENARIO]
        errors = f"{result['velocity_error']:.3f} m/s, {result['yaw_rate_error']:.3f} rad/s, falls"
        print(
            f"{name}: {result['success_rate']:.0%} of {validation.episodes} succeed, {errors} {result['fall_rate']:.0%}"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_code(lambda: main(sys.argv[1:])))
