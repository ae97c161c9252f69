"""Limits of the settings, and the rules between them."""

import dataclasses
from collections.abc import Sequence

from evaluate.rollouts import hardware
from policies.parameters import limits_of
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.named import scenario
from train.config import TrainConfig

POSES = ("crouch", "stand")
"""Bases of an end-to-end policy."""
LARGEST_REWARD_WEIGHT, LARGEST_SHARE = 1e4, 1e6
MOST_HIDDEN_LAYERS, LARGEST_ROLLOUT = 8, 2**24
"""Of a bundle; samples."""


def check(config: TrainConfig) -> None:
    """Raise UsageError, one line, on settings that cannot be trained with."""
    for group, part in (("", config), ("ppo.", config.ppo), ("validation.", config.validation)):
        check_numbers(part, limits_of(part), group)
    terms = [each.name for each in dataclasses.fields(config.rewards)]
    check_numbers(config.rewards, dict.fromkeys(terms, (-LARGEST_REWARD_WEIGHT, LARGEST_REWARD_WEIGHT)), "rewards ")
    if max(len(config.ppo.actor), len(config.ppo.critic)) > MOST_HIDDEN_LAYERS:
        raise UsageError(f"--ppo.actor and --ppo.critic must be at most {MOST_HIDDEN_LAYERS} widths")
    total = config.ppo.envs * config.ppo.rollout_steps
    if total % config.ppo.minibatch or total > LARGEST_ROLLOUT:
        what = f"--ppo.minibatch, {config.ppo.minibatch}, must divide ppo.envs x ppo.rollout-steps, {total}"
        raise UsageError(f"{what}, which must be at most {LARGEST_ROLLOUT}")
    try:
        hardware.check(config.hardware)
    except ValueError as error:
        raise UsageError(str(error)) from None
    _check_mixture(config)
    check_scenarios("--validation.scenarios", config.complete_validation.scenarios, config.hardware.quadruped)
    names = dict.fromkeys((*dict(config.mixture), *config.complete_validation.scenarios))
    real = ", ".join(name for name in names if scenario(name, config.hardware.quadruped).hardware)
    if real and config.hardware.chosen:
        raise UsageError(f"{real}: the profile has its own --actuator, --sensors and --estimator: leave these out")
    if config.policy == "end-to-end" and config.base not in POSES:
        raise UsageError(f"--policy end-to-end learns on --base {' or '.join(POSES)}, not on {config.base}")


def _check_mixture(config: TrainConfig) -> None:
    shares = [share for _, share in config.mixture]
    check_scenarios("--mixture", [name for name, _ in config.mixture], config.hardware.quadruped)
    if not all(0 <= share <= LARGEST_SHARE for share in shares):
        raise UsageError(f"--mixture needs shares that are not negative and at most {LARGEST_SHARE:g}, as in: flat 0.5")
    # Smaller than any share that means something, and the quotients below stay finite.
    if sum(shares) < 1e-6:
        raise UsageError("--mixture: at least one share must be above zero")


def check_scenarios(option: str, names: Sequence[str], robot: Robot = SIMPLE_QUAD) -> None:
    """Raise UsageError, one line, where an option names no scenario, an unknown one or one twice."""
    if not names:
        raise UsageError(f"{option} needs at least one scenario")
    for name in names:
        try:
            scenario(name, robot)
        except ValueError as error:
            raise UsageError(f"{option}: {error}") from None
    if len(set(names)) < len(names):
        raise UsageError(f"{option} names a scenario twice")
