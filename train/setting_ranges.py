"""Limits of the settings, and the rules between them."""

import dataclasses
from collections.abc import Sequence

from evaluate.rollouts import hardware
from policies.parameters import limits_of
from quad_env.cli.command_line import UsageError
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.named import scenario
from train.config import TrainConfig

POSES = ("crouch", "stand")
"""Bases of an end-to-end policy."""
LARGEST_REWARD_WEIGHT = 1e4
LARGEST_SHARE = 1e6
LARGEST_WIDTH, MOST_HIDDEN_LAYERS = 4096, 8
"""Limits of a bundle."""
LARGEST_ROLLOUT = 2**24
"""Samples."""


def check(config: TrainConfig) -> None:
    """Raise UsageError, one line, on settings that cannot be trained with."""
    for prefix, part in (("--", config), ("--ppo.", config.ppo), ("--validation.", config.validation)):
        for name, (low, high) in limits_of(part).items():
            if (value := getattr(part, name)) is not None:
                _check_range(prefix + name, value, low, high)
    for name, weight in dataclasses.asdict(config.rewards).items():
        _check_range(f"--rewards {name}", weight, -LARGEST_REWARD_WEIGHT, LARGEST_REWARD_WEIGHT)
    _check_layers("--ppo.actor", config.ppo.actor)
    _check_layers("--ppo.critic", config.ppo.critic)
    _check_rollout(config)
    try:
        hardware.check(config.hardware)
    except ValueError as error:
        raise UsageError(str(error)) from None
    _check_mixture(config)
    check_scenarios("--validation.scenarios", config.complete_validation.scenarios, config.hardware.quadruped)
    names = (*(name for name, _ in config.mixture), *config.complete_validation.scenarios)
    real = [name for name in dict.fromkeys(names) if scenario(name, config.hardware.quadruped).hardware]
    if real and config.hardware.chosen:
        which = ", ".join(real)
        raise UsageError(f"{which}: the profile has its own --actuator, --sensors and --estimator: leave these out")
    if config.policy == "end-to-end" and config.base not in POSES:
        raise UsageError(f"--policy end-to-end learns on --base {' or '.join(POSES)}, not on {config.base}")


def _check_range(option: str, value: float, low: float, high: float) -> None:
    # NaN is in no range.
    if not low <= value <= high:
        ends = " to ".join(str(end) if isinstance(end, int) else f"{end:g}" for end in (low, high))
        raise UsageError(f"{option.replace('_', '-')} must be from {ends}, got {value}")


def _check_layers(option: str, widths: Sequence[int]) -> None:
    if len(widths) > MOST_HIDDEN_LAYERS or not all(1 <= width <= LARGEST_WIDTH for width in widths):
        raise UsageError(
            f"{option} must be at most {MOST_HIDDEN_LAYERS} widths from 1 to {LARGEST_WIDTH}, "
            f"got {' '.join(map(str, widths))}"
        )


def _check_rollout(config: TrainConfig) -> None:
    ppo = config.ppo
    total = ppo.envs * ppo.rollout_steps
    if total % ppo.minibatch:
        raise UsageError(f"--ppo.minibatch must divide ppo.envs x ppo.rollout-steps = {total}, got {ppo.minibatch}")
    if total > LARGEST_ROLLOUT:
        raise UsageError(f"ppo.envs x ppo.rollout-steps must be at most {LARGEST_ROLLOUT}, got {total}")


def _check_mixture(config: TrainConfig) -> None:
    shares = [share for _, share in config.mixture]
    check_scenarios("--mixture", [name for name, _ in config.mixture], config.hardware.quadruped)
    if not all(0 <= share <= LARGEST_SHARE for share in shares):
        raise UsageError(
            f"--mixture needs shares that are not negative and at most {LARGEST_SHARE:g}, as in: "
            "--mixture flat 0.5 push 0.5"
        )
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
