"""Seeds: disjoint families keyed by purpose, and the independent random streams of each episode."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

PURPOSES = ("user", "training", "validation", "search", "evaluation")
_FAMILY_BITS = 48


def episode_seeds(purpose: str, seed: int, count: int) -> NDArray[np.int64]:
    """Episode seeds of one purpose, shape (count,).

    The bits above the 48th hold the purpose, so that no seed of one purpose is ever one of another, whatever `seed`
    says; the first purpose, "user", is left to the small integers that people type.
    """
    if purpose not in PURPOSES:
        raise ValueError(f"unknown purpose {purpose!r}; valid: {', '.join(PURPOSES)}")
    if seed < 0 or count < 0:
        raise ValueError(f"seed and count must not be negative, got {seed} and {count}")
    family = PURPOSES.index(purpose)
    words = np.random.SeedSequence((family, seed)).generate_state(count, np.uint64)
    return (words >> np.uint64(64 - _FAMILY_BITS)).astype(np.int64) | (family << _FAMILY_BITS)


def fresh_seeds(count: int) -> list[int]:
    """Seeds for envs that are given none, from the operating system's entropy."""
    return [int(seed) for seed in np.random.SeedSequence().generate_state(count)]


def _stream(number: int) -> "cached_property[np.random.Generator]":
    """The stream of that number, made when it is first drawn from; a new kind shifts none of the others."""

    def make(streams: "EpisodeStreams") -> np.random.Generator:
        seed = np.random.SeedSequence(streams.seed, spawn_key=(streams.episode, number))
        return np.random.Generator(np.random.PCG64(seed))

    return cached_property(make)


class EpisodeStreams:
    """Random generators of one episode, one for each kind of draw, so that none shifts another.

    Episode k after a seed is the seed's k-th child: `SeedSequence(seed, spawn_key=(k,))`.
    """

    def __init__(self, seed: int, episode: int) -> None:
        self.seed, self.episode = seed, episode

    start = _stream(0)
    commands = _stream(1)
    pushes = _stream(2)
    force = _stream(3)
    """Direction of the steady force."""
    payload = _stream(4)
    """Place of the payload."""
    noise = _stream(5)
    """Noise on the observation."""
    dropouts = _stream(6)
    sensors = _stream(7)
    """Biases, offsets and noise of the sensors."""
    scan_noise = _stream(8)
    """Noise of the height scan."""
    randomisation = _stream(9)
    """Figures of the robot and the ground, where these differ from episode to episode."""


def seeds_of(seed: int | Sequence[int], num_envs: int) -> list[Any]:
    """A seed for each env; None, in a sequence, leaves that env's own."""
    single = isinstance(seed, int | np.integer)
    seeds = [int(seed) + i for i in range(num_envs)] if single else list(seed)  # type: ignore[arg-type]
    if len(seeds) != num_envs:
        raise ValueError(f"{len(seeds)} seeds for {num_envs} environments")
    for each in seeds:
        if each is not None and (isinstance(each, bool) or not isinstance(each, int | np.integer) or each < 0):
            raise ValueError(f"a seed must be a whole number of at least 0, got {each!r}")
    return [None if each is None else int(each) for each in seeds]
