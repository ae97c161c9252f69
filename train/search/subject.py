"""A search as a value: its effort, its start, the space around it, the cost of candidates, and what follows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.tracking import SETTLING_TIME
from policies.base import CONTROL_PERIOD, Floats
from policies.parameters import Parameters, number
from quad_env.seeding import episode_seeds

Ranges = Mapping[str, tuple[float, float]]
"""Bounds of the parameters that are searched, by field name."""
Seeds = NDArray[np.int64]
MARGIN = 0.02
"""Least distance of a start from the faces of the unit cube."""
SHORTEST = round(SETTLING_TIME / CONTROL_PERIOD) + 1
"""Shortest episode, control steps: longer than the settling time, which no measure counts."""

P = TypeVar("P", bound=Parameters)


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How thoroughly is searched, and where the outcome goes: options of every search."""

    seed: int = number(0, limits=(0, 2**31))
    """Seed of the search."""
    generations: int = number(14, limits=(0, 10_000))
    """Rounds; 0 only does what follows the search."""
    candidates: int = number(14, limits=(4, 1000))
    """Parameter sets tried in a round."""
    episodes: int = number(10, limits=(1, 10_000))
    """Episodes of a candidate in each scenario and round."""
    steps: int = number(600, limits=(SHORTEST, 100_000))
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int = number(108, limits=(1, 10_000))
    """Fresh episodes on which the outcome is finished and compared with the parameters before."""
    spread: float = number(0.15, limits=(1e-6, 0.5))
    """First standard deviation of a parameter, as a share of its range."""
    threads: int = number(2, limits=(1, 256))
    """Threads of the simulation."""
    out: Path | None = None
    """File of the outcome, JSON, by default the one that the policy reads; other files of the search are written next
    to it."""

    def command(self, program: str) -> str:
        """The command that repeats the search."""
        words = [program]
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name == "seed" or (value != each.default and each.name not in ("threads", "out")):
                entries = map(str, value if isinstance(value, tuple) else (value,))
                words += [f"--{each.name.replace('_', '-')}", *entries]
        return " ".join(words)


@dataclass(frozen=True)
class Subject(Generic[P]):
    """What is searched: parameters, each of which goes from 0 to 1 over its range, in the unit cube."""

    start: P
    ranges: Ranges
    costs: Callable[[list[P], Seeds], Sequence[float] | Floats]
    """Costs of a generation's candidates on the same episodes."""
    conclude: Callable[[P], tuple[str, str]]
    """Of the mean of the last generation the text of the file, and the account of how it was found, Markdown."""
    file: Path
    """Where the outcome goes."""
    account: str
    """File of the account, next to the outcome."""
    digits: int | None = None
    """To which candidates are rounded."""
    apart: bool = False
    """Whether each parameter has a spread of its own, for spaces with too many to learn how they go together."""


def decode(point: Floats, start: P, ranges: Ranges, digits: int | None = None) -> P:
    """Parameters of a point of the unit cube, rounded where digits are given; those not searched are the start's."""
    values = {name: low + (high - low) * float(x) for x, (name, (low, high)) in zip(point, ranges.items(), strict=True)}
    return replace(start, **(values if digits is None else {name: round(x, digits) for name, x in values.items()}))


def encode(parameters: Parameters, ranges: Ranges) -> Floats:
    """Point of the unit cube of some parameters."""
    return np.array([(getattr(parameters, name) - low) / (high - low) for name, (low, high) in ranges.items()])


def rounded(parameters: P) -> P:
    """The parameters to four digits."""
    return replace(parameters, **{name: round(float(value), 4) for name, value in vars(parameters).items()})


def generations(effort: Effort) -> list[Seeds]:
    """Seeds of the episodes of each generation, new ones in each."""
    seeds = episode_seeds("search", effort.seed, effort.generations * effort.episodes)
    return [seeds[place : place + effort.episodes] for place in range(0, len(seeds), effort.episodes)]
