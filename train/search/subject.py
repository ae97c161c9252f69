"""A subject of a search as a value: its start, the space around it, the cost of candidates, and what follows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
import tyro
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

T = TypeVar("T")
P = TypeVar("P", bound=Parameters)


@dataclass(frozen=True)
class Effort:
    """How thoroughly a subject is searched."""

    generations: int
    candidates: int
    episodes: int
    """Of a candidate in each scenario and generation."""
    steps: int
    """Length of an episode, control steps."""
    check_episodes: int
    """For what is done with the outcome, in each scenario."""
    spread: float


@dataclass(frozen=True)
class Options:
    """What is searched, and how thoroughly; numbers that are not given are the subject's own."""

    subject: Annotated[Literal["trot", "feedback"], tyro.conf.Positional]
    """trot: the open-loop trot. feedback: gait and gains of --policy."""
    policy: Literal["mpc_wbc", "trot_feedback", "trot_integral"] | None = None
    """Policy of `search feedback`; trot_feedback when not given."""
    robot: str | None = None
    """Robot of `search trot`: a name of quad_env.ROBOTS such as go1, or the path of its MJCF, URDF or TOML."""
    seed: int = number(0, limits=(0, 2**31))
    """Seed of the search."""
    generations: int | None = None
    """Rounds; 0 only does what follows the search."""
    candidates: int | None = None
    """Parameter sets tried in a round."""
    episodes: int | None = None
    """Episodes of a candidate in each scenario."""
    steps: int | None = None
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int | None = None
    """Fresh episodes on which the outcome is finished and compared with the parameters before."""
    spread: float | None = None
    """First standard deviation of a parameter, as a share of its range."""
    exercises: tuple[str, ...] = ()
    """Scenarios of `search feedback`, all of one weight, such as flat push=42; 21 when not given."""
    start: Path | None = None
    """Parameters that `search feedback` starts from, JSON, instead of those in force."""
    threads: int = number(2, limits=(1, 256))
    """Threads of the simulation."""
    out: Path | None = None
    """File of the outcome, JSON, by default the one that the policy reads; other files of the search are written next
    to it."""

    @property
    def command(self) -> str:
        """The command that repeats the search."""
        words = ["python -m train search", self.subject]
        for each in fields(self)[1:]:
            value = getattr(self, each.name)
            if each.name == "seed" or (value not in (None, ()) and each.name not in ("threads", "out")):
                entries = value if isinstance(value, tuple) else (value,)
                words.append(f"--{each.name.replace('_', '-')} {' '.join(map(str, entries))}")
        return " ".join(words)


@dataclass(frozen=True)
class Space(Generic[T]):
    """The points of a search, in the unit cube, and what the parameters of a point cost."""

    start: Floats
    decode: Callable[[Floats], T]
    costs: Callable[[list[T], Seeds], Sequence[float] | Floats]
    """Costs of a generation's candidates on the same episodes."""
    seeds: Sequence[Seeds]
    """Of each generation's episodes."""
    apart: bool = False
    """Whether each parameter has a spread of its own, for spaces with too many to learn how they go together."""


@dataclass(frozen=True)
class Outcome:
    """What is left of a search."""

    text: str
    """Of the file."""
    account: str
    """How it was found, Markdown."""


@dataclass(frozen=True)
class Subject(Generic[T]):
    """What is searched."""

    start: T
    file: Path
    """Where the outcome goes."""
    conclude: Callable[[T], Outcome]
    """What is made of the mean of the last generation."""
    space: Space[T]
    account: str
    """File of the account, next to the outcome."""


def unit_cube(
    start: P,
    ranges: Ranges,
    costs: Callable[[list[P], Seeds], Sequence[float] | Floats],
    seeds: Sequence[Seeds],
    *,
    digits: int | None = None,
    apart: bool = False,
) -> Space[P]:
    """The space in which each searched parameter goes from 0 to 1 over its range."""
    point = np.clip(encode(start, ranges), MARGIN, 1.0 - MARGIN)
    return Space(point, lambda each: decode(each, start, ranges, digits), costs, seeds, apart)


def decode(point: Floats, start: P, ranges: Ranges, digits: int | None = None) -> P:
    """Parameters of a point of the unit cube, rounded where digits are given; those not searched are the start's."""
    values = {name: low + (high - low) * float(x) for x, (name, (low, high)) in zip(point, ranges.items(), strict=True)}
    return replace(start, **(values if digits is None else {name: round(x, digits) for name, x in values.items()}))


def encode(parameters: Parameters, ranges: Ranges) -> Floats:
    """Point of the unit cube of some parameters."""
    return np.array([(getattr(parameters, name) - low) / (high - low) for name, (low, high) in ranges.items()])


def rounded(parameters: P) -> P:
    """The parameters to four digits."""
    values: dict[str, Any] = {each.name: round(float(getattr(parameters, each.name)), 4) for each in fields(parameters)}
    return replace(parameters, **values)


def generations(seed: int, effort: Effort) -> list[Seeds]:
    """Seeds of the episodes of each generation, new ones in each."""
    seeds = episode_seeds("search", seed, effort.generations * effort.episodes)
    return [seeds[place : place + effort.episodes] for place in range(0, len(seeds), effort.episodes)]
