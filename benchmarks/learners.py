"""`python -m benchmarks.learners`: off-policy learners beside PPO, on the same robots for the same wall time.

PPO is the default command of `python -m train`, and the others get as long as that takes: SAC of Stable-Baselines3, TQC
and CrossQ of sb3-contrib (`pip install sb3-contrib`), each from the base's own actions and with the settings below.
Success is that of the scenarios trained on, on validation episodes; the clock stands still while they are judged.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from torch import nn

import policies
from benchmarks.probes.training_run import learner
from benchmarks.support.command import Outcome, Output, command, table
from benchmarks.support.measure import cores
from benchmarks.support.progress import stage
from policies.base import Policy
from policies.network import Network
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import launch
from train.config import DEFAULTS, PpoConfig, TrainConfig
from train.run import make_env
from train.sb3.callbacks import CallbackState, Schedules, Segments, corrected_by, current_policy
from train.validation import success, validate

SHARED: Mapping[str, Any] = {
    "buffer_size": 500_000,
    "batch_size": 512,
    "learning_starts": 20_000,
    "train_freq": 1,
    "gamma": 0.98,
    "device": "cpu",
}
"""Of every off-policy learner; a step of the robots is one of `train_freq`."""
OWN: Mapping[str, Mapping[str, Any]] = {
    "sac": {"gradient_steps": 8, "learning_rate": 1e-3, "ent_coef": "auto_0.05"},
    "tqc": {"gradient_steps": 6, "learning_rate": 1e-3, "ent_coef": "auto_0.05"},
    "crossq": {"gradient_steps": 6, "learning_rate": 1e-3, "ent_coef": "auto_0.05"},
}
"""Settings of each one; as many gradient steps a step of all robots as leave half of the time to the physics."""


@dataclass(frozen=True)
class Options(Output):
    """Which learners, on which training seed."""

    learners: tuple[str, ...] = tuple(OWN)
    """Beside PPO: sac, tqc, crossq."""
    seed: int = 0
    """Training seed."""
    episodes: int = 24
    """Episodes of the judgement (count), a scenario."""
    threads: int = cores()
    """Threads of the simulation (count; default: this machine's cores)."""


class Trained(NamedTuple):
    """What a learner came to."""

    policy: Policy
    seconds: float
    """Wall time of the training."""
    steps: int
    """Of the learner, all robots together."""
    updates: int
    """Gradient steps."""


def measure(options: Options) -> Outcome:
    """A row a learner. Raises UsageError for an unknown learner, or sb3-contrib that is missing."""
    kinds = {name: _kind(name) for name in options.learners}
    config = replace(DEFAULTS["residual"], seed=options.seed, threads=options.threads)
    if options.quick:
        tiny = PpoConfig(envs=8, rollout_steps=4, minibatch=16, epochs=1, actor=(4,), critic=(4,))
        config = replace(config, ppo=tiny, mixture=(("flat", 1.0),), steps=64)
    rows = table(
        "The same robots, the same wall time", "learner", "success", "flat error, m/s", "min", "steps", "updates"
    )
    figures: dict[str, Any] = {}
    with stage("learners", 1 + len(kinds)) as advance:
        trained = {"ppo": _ppo(config)}
        advance()
        for name, kind in kinds.items():
            trained[name] = _off_policy(config, kind, OWN[name], trained["ppo"].seconds)
            advance()
    judged = replace(config.complete_validation, episodes=1 if options.quick else options.episodes)
    untrained = Trained(policies.make(config.base), 0.0, 0, 0)
    for name, each in {config.base: untrained, **trained}.items():
        found = validate(each.policy, judged, config.threads, config.hardware)
        error, minutes = found["flat"]["velocity_error"], each.seconds / 60.0
        rows.add_row(
            name, f"{success(found):.1%}", f"{error:.3f}", f"{minutes:.1f}", f"{each.steps:,}", f"{each.updates:,}"
        )
        counts = {"seconds": each.seconds, "steps": each.steps, "updates": each.updates}
        figures[name] = counts | {"success": success(found), "scenarios": found}
    return Outcome(figures, (rows,), notes=(f"settings of the off-policy learners: {dict(SHARED)}, {dict(OWN)}",))


def _kind(name: str) -> type[OffPolicyAlgorithm]:
    if name not in OWN:
        raise UsageError(f"unknown learner {name!r}; there are {', '.join(OWN)}")
    if name == "sac":
        return SAC
    try:
        import sb3_contrib
    except ImportError:
        raise UsageError(f"{name} is in sb3-contrib: pip install sb3-contrib") from None
    kinds = {"tqc": sb3_contrib.TQC, "crossq": sb3_contrib.CrossQ}
    return cast("type[OffPolicyAlgorithm]", kinds[name])


def _ppo(config: TrainConfig) -> Trained:
    """The default command, without validation."""
    env, begin = make_env(config), time.perf_counter()
    try:
        model = learner(config, env)
        state = CallbackState()
        model.learn(config.steps, [Schedules(config, state), Segments(config, state)])
        seconds = time.perf_counter() - begin
        return Trained(current_policy(config, model), seconds, model.num_timesteps, _gradient_steps(config, model))
    finally:
        env.close()


def _gradient_steps(config: TrainConfig, model: PPO) -> int:
    ppo = config.ppo
    return model._n_updates * (ppo.envs * ppo.rollout_steps // ppo.minibatch)


def _off_policy(config: TrainConfig, kind: type[OffPolicyAlgorithm], own: Mapping[str, Any], seconds: float) -> Trained:
    """That learner after as many seconds. Its critic sees what the actor sees: these have no other place for more."""
    torch.set_num_threads(1)
    env, begin = make_env(config, privileged=False), time.perf_counter()
    try:
        widths = {"net_arch": list(config.ppo.actor), "activation_fn": nn.ELU}
        settings = {**SHARED, **own, "learning_starts": min(SHARED["learning_starts"], config.steps // 4)}
        model = kind("MlpPolicy", env, seed=config.seed, policy_kwargs=widths, **settings)
        model.set_logger(Logger(None, []))
        actor = cast(Any, model.policy).actor
        nn.init.zeros_(actor.mu.weight)
        nn.init.zeros_(actor.mu.bias)
        nn.init.zeros_(actor.log_std.weight)
        nn.init.constant_(actor.log_std.bias, config.ppo.log_std_init)
        model.learn(10**12, _Until(begin + seconds))
        policy = corrected_by(cast(Network, _Actor(model, env.observation_space.shape or (0,))), config, env)
        return Trained(policy, time.perf_counter() - begin, model.num_timesteps, model._n_updates)
    finally:
        env.close()


class _Until(BaseCallback):
    """Ends the training at a moment of `time.perf_counter`."""

    def __init__(self, end: float) -> None:
        super().__init__()
        self._end = end

    def _on_step(self) -> bool:
        return time.perf_counter() < self._end


class _Actor:
    """A squashed actor in the place of a bundle's network."""

    def __init__(self, model: OffPolicyAlgorithm, seen: tuple[int, ...]) -> None:
        self._model = model
        self.sizes = (*seen, *(model.action_space.shape or ()))

    def __call__(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Corrections (n, k) for features (n, m)."""
        return np.asarray(self._model.predict(cast(Any, inputs), deterministic=True)[0], np.float32)


main = command(Options, measure, "benchmarks.learners", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
