"""Disjoint sets of seeds for training, validation, search and evaluation; random streams."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

PURPOSES = ("user", "training", "validation", "search", "evaluation")
"""Purposes of seeds. Each purpose has a family, a set of seeds that is disjoint from all other families."""
_FAMILY_BITS = 48
"""Number of low bits of a seed that vary within a family; the higher bits are the index of the purpose."""


def episode_seeds(purpose: str, seed: int, count: int) -> NDArray[np.int64]:
    """Return episode seeds of one purpose.

    The bits above the lowest 48 are the index of the purpose, so that seeds of two purposes differ for every `seed`.
    The family of the first purpose, "user", includes the small integers that people type.

    Args:
        purpose: One of `PURPOSES`.
        seed: Seed of the random sequence of episode seeds, >= 0.
        count: Number of seeds, >= 0.

    Returns:
        Seeds, (count,).

    Raises:
        ValueError: The purpose is unknown, or the seed or count is negative.
    """
    if purpose not in PURPOSES:
        raise ValueError(f"unknown purpose {purpose!r}; valid: {', '.join(PURPOSES)}")
    if seed < 0 or count < 0:
        raise ValueError(f"seed and count must not be negative, got {seed} and {count}")
    family = PURPOSES.index(purpose)
    words = np.random.SeedSequence((family, seed)).generate_state(count, np.uint64)
    return (words >> np.uint64(64 - _FAMILY_BITS)).astype(np.int64) | (family << _FAMILY_BITS)


def fresh_seeds(count: int) -> list[int]:
    """Return `count` random seeds from the entropy of the operating system, for envs that got no seed."""
    return [int(seed) for seed in np.random.SeedSequence().generate_state(count)]


def _stream(number: int) -> "cached_property[np.random.Generator]":
    """Return a property with the random generator of stream `number`, made on first use.

    A stream does not depend on the other streams.
    """

    def make(streams: "EpisodeStreams") -> np.random.Generator:
        seed = np.random.SeedSequence(streams.seed, spawn_key=(streams.episode, number))
        return np.random.Generator(np.random.PCG64(seed))

    return cached_property(make)


class EpisodeStreams:
    """Random generators of one episode, with an independent generator for each kind of draw.

    Stream i of episode k has the seed `SeedSequence(seed, spawn_key=(k, i))`.

    Args:
        seed: Seed of the robot.
        episode: Number of episodes since the reset with this seed.
    """

    def __init__(self, seed: int, episode: int) -> None:
        self.seed = seed
        self.episode = episode

    start = _stream(0)
    """Start state."""
    commands = _stream(1)
    """Velocity commands."""
    pushes = _stream(2)
    """Times and directions of pushes."""
    force = _stream(3)
    """Direction of the steady force."""
    payload = _stream(4)
    """Position of the payload."""
    noise = _stream(5)
    """Noise on the observation."""
    dropouts = _stream(6)
    """Times and joints of dropouts."""
    sensors = _stream(7)
    """Biases, offsets and noise of the sensors."""
    scan_noise = _stream(8)
    """Noise of the height scan."""
    randomisation = _stream(9)
    """Domain randomisation of robot and ground."""


def assign_seeds(seed: int | Sequence[int], num_envs: int) -> list[Any]:
    """Return a seed for each env.

    Args:
        seed: One number, from which env i gets `seed` + i, or a sequence with a seed for each env. None in a sequence
            keeps the present seed of the env.
        num_envs: Number of envs.

    Returns:
        Seed of each env, or None.

    Raises:
        ValueError: The number of seeds is wrong, or a seed is not a whole number of at least 0.
    """
    is_single = isinstance(seed, int | np.integer)
    seeds = [int(seed) + i for i in range(num_envs)] if is_single else list(seed)  # type: ignore[arg-type]
    if len(seeds) != num_envs:
        raise ValueError(f"{len(seeds)} seeds for {num_envs} environments")
    for value in seeds:
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0):
            raise ValueError(f"a seed must be a whole number of at least 0, got {value!r}")
    return [None if value is None else int(value) for value in seeds]
