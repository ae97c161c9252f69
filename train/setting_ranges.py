"""What can be trained with: the range of each number, and the few rules that join two settings."""

from collections.abc import Sequence

from evaluate.terminal.command_line import UsageError
from quad_env.scenarios.named import Pushes, scenario
from train.config import TrainConfig, to_dict

_PUSHES = Pushes()
# One fewer than would fill the window: rounding must leave each push some room.
_MOST_PUSHES = int((_PUSHES.window[1] - _PUSHES.window[0]) / _PUSHES.duration) - 1

LIMITS: dict[str, tuple[float, float]] = {
    "steps": (1, 10**12 - 1),  # a checkpoint's name has twelve digits
    "seed": (0, 2**32 - 1),  # NumPy's global generator, which SB3 seeds, takes no other
    "threads": (1, 256),
    "joint_authority": (1e-3, 3.0),
    "hip_authority": (0.0, 3.0),
    "pushes": (0, _MOST_PUSHES),
    "hardness": (0.01, 100.0),
    "max_episode_steps": (1, 1_000_000),
    "ppo.envs": (1, 65_536),
    "ppo.rollout_steps": (1, 65_536),
    "ppo.minibatch": (2, 2**24),  # advantages are normalised within one
    "ppo.epochs": (1, 1000),
    "ppo.learning_rate": (1e-9, 1.0),
    "ppo.target_kl": (1e-6, 10.0),
    "ppo.hold": (1, 1000),
    "ppo.gamma": (0.0, 1.0),
    "ppo.gae_lambda": (0.0, 1.0),
    "ppo.clip_range": (1e-3, 10.0),
    "ppo.reward_scale": (1e-6, 1e6),
    "ppo.entropy": (0.0, 10.0),
    "ppo.value_weight": (0.0, 1000.0),
    "ppo.max_gradient": (1e-6, 1e6),
    "ppo.log_std_init": (-20.0, 2.0),
    "validation.interval": (0, 10**12),
    "validation.episodes": (1, 100_000),
}
"""Smallest and largest value of each number, by its place in the settings."""
LARGEST_REWARD_WEIGHT = 1e4
LARGEST_SHARE = 1e6
LARGEST_WIDTH, MOST_HIDDEN_LAYERS = 4096, 8
"""Within what the bundle of a trained policy can describe."""
LARGEST_ROLLOUT = 2**24
"""Samples; four times that many bytes for each of the 62 features."""


def check(config: TrainConfig) -> None:
    """Raise UsageError, one line, on settings that cannot be trained with."""
    for place, (low, high) in LIMITS.items():
        _check_range(place, _at(config, place), low, high)
    for name, weight in to_dict(config)["rewards"].items():
        _check_range(f"rewards.{name}", weight, -LARGEST_REWARD_WEIGHT, LARGEST_REWARD_WEIGHT)
    if config.ppo.log_std_final is not None:
        _check_range("ppo.log_std_final", config.ppo.log_std_final, *LIMITS["ppo.log_std_init"])
    _check_layers("--ppo.actor", config.ppo.actor)
    _check_layers("--ppo.critic", config.ppo.critic)
    _check_rollout(config)
    _check_scenarios("--validation.scenarios", config.validation.scenarios)
    _check_mixture(config)
    if config.policy == "end-to-end" and config.base != "stand":
        raise UsageError(f"--policy end-to-end learns on --base stand, not on {config.base}: leave --base out")


def _at(config: TrainConfig, place: str) -> float:
    value: object = config
    for name in place.split("."):
        value = getattr(value, name)
    assert isinstance(value, int | float)
    return value


def _check_range(place: str, value: float, low: float, high: float) -> None:
    # NaN is in no range.
    if not low <= value <= high:
        option = "--" + place.replace("_", "-")
        raise UsageError(f"{option} must be from {_number(low)} to {_number(high)}, got {value}")


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"


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
    _check_scenarios("--mixture", [name for name, _ in config.mixture])
    if not all(0 <= share <= LARGEST_SHARE for share in shares):
        raise UsageError(
            f"--mixture needs shares that are not negative and at most {LARGEST_SHARE:g}, as in: "
            "--mixture flat 0.5 push 0.5"
        )
    # Smaller than any share that means something, and the quotients below stay finite.
    if sum(shares) < 1e-6:
        raise UsageError("--mixture: at least one share must be above zero")


def _check_scenarios(option: str, names: Sequence[str]) -> None:
    if not names:
        raise UsageError(f"{option} needs at least one scenario")
    for name in names:
        try:
            scenario(name)
        except ValueError as error:
            raise UsageError(f"{option}: {error}") from None
    if len(set(names)) < len(names):
        raise UsageError(f"{option} names a scenario twice")
