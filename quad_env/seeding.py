"""Seeds: disjoint families keyed by purpose, and the independent random streams of each episode."""

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


class EpisodeStreams:
    """Random generators of one episode, one for each kind of draw, so that none shifts another.

    Episode k after a seed is the seed's k-th child: `SeedSequence(seed, spawn_key=(k,))`.
    """

    def __init__(self, seed: int, episode: int) -> None:
        start, commands, pushes = np.random.SeedSequence(seed, spawn_key=(episode,)).spawn(3)
        self.start = np.random.Generator(np.random.PCG64(start))
        self.commands = np.random.Generator(np.random.PCG64(commands))
        self.pushes = np.random.Generator(np.random.PCG64(pushes))
