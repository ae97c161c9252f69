"""Seeds of episodes, which differ between training, validation, search and evaluation, and random generators.

Because the seeds differ, an evaluation episode never occurs in training or in a search for parameters.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

PURPOSES = ("user", "training", "validation", "search", "evaluation")
"""Purposes of episodes; seeds of two different purposes are always different."""
_FAMILY_BITS = 48
"""Number of low bits of an episode seed that are random; the higher bits are the index in `PURPOSES`."""


def episode_seeds(purpose: str, seed: int, count: int) -> NDArray[np.int64]:
    """Return pseudo-random episode seeds for one purpose, such as evaluation.

    The bits above the lowest 48 are the index of the purpose. Seeds of two purposes therefore differ for every `seed`.
    The seeds of the first purpose, "user", include the small integers that people type.

    Args:
        purpose: Purpose of the episodes: "user", "training", "validation", "search" or "evaluation".
        seed: Seed of the random sequence of episode seeds, >= 0.
        count: Number of episode seeds, >= 0.

    Returns:
        Episode seeds, (count,).

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
    """Return `count` unpredictable seeds from the operating system, for environments that got no seed."""
    return [int(seed) for seed in np.random.SeedSequence().generate_state(count)]


def _stream(number: int) -> "cached_property[np.random.Generator]":
    """Return a cached property of `EpisodeStreams`: the random generator with the index `number`.

    The generator is made at the first access. The numbers do not depend on the use of the other generators.
    """

    def make(streams: "EpisodeStreams") -> np.random.Generator:
        seed = np.random.SeedSequence(streams.seed, spawn_key=(streams.episode, number))
        return np.random.Generator(np.random.PCG64(seed))

    return cached_property(make)


class EpisodeStreams:
    """Random generators of one episode, an independent generator for each random quantity, such as pushes.

    Generator i of episode k has the seed `SeedSequence(seed, spawn_key=(k, i))`. A change of one kind of random
    quantity therefore does not change the others.

    Args:
        seed: Seed with which the environment of the robot was reset.
        episode: Index of the episode, counted from 0 at the reset with this seed.
    """

    def __init__(self, seed: int, episode: int) -> None:
        self.seed = seed
        self.episode = episode

    start = _stream(0)
    """Random generator of the start state: pose and velocities of the robot."""
    commands = _stream(1)
    """Random generator of the velocity commands."""
    pushes = _stream(2)
    """Random generator of the times and directions of pushes."""
    force = _stream(3)
    """Random generator of the direction of the steady external force."""
    payload = _stream(4)
    """Random generator of the position of the payload on the trunk."""
    noise = _stream(5)
    """Random generator of the noise on the observation."""
    dropouts = _stream(6)
    """Random generator of times and joints of dropouts; in a dropout a joint servo receives no new targets."""
    sensors = _stream(7)
    """Random generator of the biases, offsets and noise of the simulated sensors."""
    scan_noise = _stream(8)
    """Random generator of the noise of the height scan of the terrain."""
    randomisation = _stream(9)
    """Random generator of the domain randomisation of robot and ground."""
    scan_dropouts = _stream(10)
    """Random generator of times and sides of the dropouts of the height scan."""


def assign_seeds(seed: int | Sequence[int], num_envs: int) -> list[Any]:
    """Return a seed for each environment of a vector environment.

    Args:
        seed: One integer, or a sequence with a seed for each environment. From one integer, environment i gets
            `seed` + i. None in a sequence means that the environment keeps its present seed.
        num_envs: Number of environments.

    Returns:
        Seed of each environment; None if the environment keeps its present seed.

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
