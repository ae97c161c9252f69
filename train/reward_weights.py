"""Reward weights as an option, `NAME=WEIGHT` words."""

import dataclasses
from collections.abc import Sequence
from typing import Annotated

from tyro.constructors import PrimitiveConstructorSpec

from quad_env.config import RewardWeights

REWARDS = RewardWeights(linear_velocity_error=-0.6, yaw_rate_error=-0.3, fall=-5.0)
"""The environment's, and a slope where the robot is so far off its command that the tracking rewards are flat. A second
there costs about 1: less than a fall, or falling would earn more."""


def weights(words: Sequence[str]) -> RewardWeights:
    """The default weights with those of `NAME=WEIGHT` words. Raises ValueError."""
    names, changed = [each.name for each in dataclasses.fields(RewardWeights)], dict[str, float]()
    for word in words:
        name, _, value = word.partition("=")
        if (field := name.replace("-", "_")) not in names:
            raise ValueError(f"there is no reward term {name!r}; valid: {', '.join(names)}")
        changed[field] = float(value)
    return dataclasses.replace(REWARDS, **changed)


def weight_words(rewards: RewardWeights) -> list[str]:
    """The inverse of `weights`."""
    return [f"{name.replace('_', '-')}={weight}" for name, weight in dataclasses.asdict(rewards).items()]


_WORDS = PrimitiveConstructorSpec(
    nargs="*", metavar="NAME=WEIGHT [NAME=WEIGHT ...]", instance_from_str=weights,
    is_instance=lambda value: isinstance(value, RewardWeights), str_from_instance=weight_words,
)  # fmt: skip
Weights = Annotated[RewardWeights, _WORDS]
