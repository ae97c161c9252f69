"""PPO in one file of plain torch, on `train.residual_env.ResidualVectorEnv` as it is: another learner than our own.

    python examples/residual_ppo.py --steps 3e5 --out runs/residual-ppo
    python -m evaluate --policies trot runs/residual-ppo --scenarios flat

The clipped objective is that of Schulman et al., 2017 (arXiv:1707.06347), the advantages are those of Schulman et al.,
2015 (arXiv:1506.02438). No curriculum, no privileged critic, no checkpoints: `python -m train` has these.
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

ROLLOUT, EPOCHS, MINIBATCHES = 24, 5, 4
"""Steps of each robot between two updates; passes over them; gradient steps in a pass."""
GAMMA, LAMBDA = 0.985, 0.95
"""Discount a step; lambda of the generalised advantage estimate."""
RATE, CLIP, LARGEST_GRADIENT = 1e-3, 0.2, 1.0
"""Adam's step size, which falls linearly to zero; clip of the probability ratio; norm that gradients are cut to."""
REWARD_SCALE = 10.0
"""Brings returns to about unit size."""
LOG_STD = -2.0
"""Logarithm of the noise at first, in shares of the authority."""
SCENARIO = "flat"
Report = Callable[[int, float], None]
"""Receives the steps so far and the mean reward of a step."""


@dataclass(frozen=True)
class Options:
    """What is trained."""

    steps: int = parameter(300_000, limits=(1, 10**12))
    """Steps of all robots together, rounded up to whole rollouts."""
    base: BaseName = "trot"
    """Base policy that the correction is added to."""
    seed: int = parameter(0, limits=(0, 2**32 - 1))
    """Seed of networks, noise and episodes."""
    out: Path = Path("runs/residual-ppo")
    """Folder that gets the bundle; one that is there is replaced."""
    envs: int = parameter(256, limits=(1, 65_536))
    """Robots side by side."""
    threads: int = parameter(2, limits=(1, 256))
    """Threads of the simulation."""


class Learner(nn.Module):
    """A Gaussian policy, whose mean the actor gives, and a critic; zero everywhere at first, so that the base walks."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.actor, self.critic = _network(inputs, outputs), _network(inputs, 1)
        self.log_std = nn.Parameter(torch.full((outputs,), LOG_STD))

    def act(self, seen: Tensor) -> Tensor:
        """Actions, (..., k), drawn for what is seen, (..., m)."""
        mean: Tensor = self.actor(seen)
        return mean + self.log_std.exp() * torch.randn_like(mean)

    def log_density(self, seen: Tensor, actions: Tensor) -> Tensor:
        """Logarithm of the actions' density, (...), up to a constant, which ratios are free of."""
        off: Tensor = (actions - self.actor(seen)) / self.log_std.exp()
        return -(0.5 * off.square() + self.log_std).sum(-1)

    def value(self, seen: Tensor) -> Tensor:
        """Expected return, (...), of what is seen, (..., m)."""
        value: Tensor = self.critic(seen).squeeze(-1)
        return value

    def network(self) -> Network:
        """The mean of the policy as the NumPy network that a bundle holds."""
        layers = [layer for layer in self.actor if isinstance(layer, nn.Linear)]
        weights = tuple(np.ascontiguousarray(layer.weight.detach().numpy().T) for layer in layers)
        return Network(weights, tuple(layer.bias.detach().numpy().copy() for layer in layers))


def _network(inputs: int, outputs: int, hidden: int = 128) -> nn.Sequential:
    last = nn.Linear(hidden, outputs)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(inputs, hidden), nn.ELU(), nn.Linear(hidden, hidden), nn.ELU(), last)


class Rollout(NamedTuple):
    """t steps of n robots, in the order that they were taken."""

    seen: Tensor
    """(t, n, m)"""
    actions: Tensor
    """(t, n, k)"""
    log_density: Tensor
    """Of the actions, (t, n)."""
    values: Tensor
    """By the critic, of what was seen, and in the end of what is seen next: (t + 1, n)."""
    rewards: Tensor
    """Scaled, (t, n); in the last of an episode that was cut, what would have come by the critic is added."""
    ended: Tensor
    """Whether an episode ended with the step, (t, n)."""


def learn(env: VectorEnv[Any, Any, Any], steps: int, seed: int, episodes: Sequence[int], report: Report) -> Learner:
    """A learner trained on an environment with same-step autoreset; `episodes` are the seeds of its reset."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # more make networks of this size slower
    learner = Learner(env.single_observation_space.shape[0], env.single_action_space.shape[0])  # type: ignore[index]
    optimiser = torch.optim.Adam(learner.parameters(), lr=RATE)
    seen = torch.as_tensor(env.reset(seed=episodes)[0])  # type: ignore[arg-type]  # ours takes one each
    updates = -(-steps // (ROLLOUT * env.num_envs))
    for done in range(updates):
        optimiser.param_groups[0]["lr"] = RATE * (1.0 - done / updates)
        rollout, seen, reward = collect(env, learner, seen)
        update(learner, optimiser, rollout)
        report((done + 1) * ROLLOUT * env.num_envs, reward)
    return learner


@torch.no_grad()
def collect(env: VectorEnv[Any, Any, Any], learner: Learner, seen: Tensor) -> tuple[Rollout, Tensor, float]:
    """A rollout from what is `seen`, what is seen after it, and its mean reward."""
    steps, total = [], 0.0
    for _ in range(ROLLOUT):
        action = learner.act(seen)
        following, reward, terminated, truncated, infos = env.step(action.numpy())
        total += reward.mean()
        scaled = torch.as_tensor(REWARD_SCALE * reward, dtype=torch.float32)
        if (cut := truncated & ~terminated).any():
            scaled += GAMMA * torch.as_tensor(cut) * learner.value(torch.as_tensor(infos["final_obs"]))
        ended = torch.as_tensor(terminated | truncated)
        steps.append((seen, action, learner.log_density(seen, action), learner.value(seen), scaled, ended))
        seen = torch.as_tensor(following)
    looked, actions, log_density, values, rewards, ends = (torch.stack(each) for each in zip(*steps, strict=True))
    values = torch.cat((values, learner.value(seen)[None]))
    return Rollout(looked, actions, log_density, values, rewards, ends), seen, float(total) / ROLLOUT


def advantages(rollout: Rollout) -> Tensor:
    """Generalised advantage estimates, (t, n); nothing after the end of an episode counts."""
    goes_on = (~rollout.ended).float()
    surprise = rollout.rewards + GAMMA * goes_on * rollout.values[1:] - rollout.values[:-1]
    found, later = torch.empty_like(surprise), torch.zeros_like(surprise[0])
    for step in reversed(range(len(surprise))):
        found[step] = later = surprise[step] + GAMMA * LAMBDA * goes_on[step] * later
    return found


def update(learner: Learner, optimiser: torch.optim.Optimizer, rollout: Rollout) -> None:
    """Improve the policy on a rollout, without going far from the one that collected it."""
    advantage = advantages(rollout)
    returns = advantage + rollout.values[:-1]
    columns = (rollout.seen, rollout.actions, rollout.log_density, advantage, returns)
    rows = [each.flatten(0, 1) for each in columns]
    for _ in range(EPOCHS):
        for chosen in torch.randperm(len(rows[0])).chunk(MINIBATCHES):
            seen, actions, log_density, gain, wanted = (each[chosen] for each in rows)
            gain = (gain - gain.mean()) / (gain.std(correction=0) + 1e-8)
            ratio = (learner.log_density(seen, actions) - log_density).exp()
            gained = torch.minimum(ratio * gain, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * gain).mean()
            loss = 0.5 * (learner.value(seen) - wanted).square().mean() - gained
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(learner.parameters(), LARGEST_GRADIENT)
            optimiser.step()


def train(options: Options, report: Report) -> None:
    """Train a residual, and leave it as a bundle in the folder."""
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


def main(words: Sequence[str]) -> int:
    """Train, and evaluate the policy and its base; the exit code."""
    options = parse(Options, list(words), program="python examples/residual_ppo.py", description=__doc__ or "")
    check_numbers(options, limits_of(options))
    make_writable_folder(options.out)
    train(options, lambda steps, reward: print(f"{steps:>10,} steps  reward {reward:.5f} a step", flush=True))
    asked = ValidationConfig(episodes=24, scenarios=(SCENARIO,))
    for name in (options.base, options.out):
        found = validate(policies.resolve(name), asked, options.threads, IDEAL)[SCENARIO]
        errors = f"{found['velocity_error']:.3f} m/s, {found['yaw_rate_error']:.3f} rad/s, falls"
        print(f"{name}: {found['success_rate']:.0%} of {asked.episodes} succeed, {errors} {found['fall_rate']:.0%}")
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_code(lambda: main(sys.argv[1:])))
