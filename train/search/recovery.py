"""Search of the poses and times of getting up: `python -m train search recovery` writes recovery.json of the behaviour.

CMA-ES from the present parameters. A generation's candidates start in the same random poses side by side in one batch,
and every generation gets new ones, all of the "search" family of seeds.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.getting_up import TIME_ALLOWED, recover_with
from policies.base import Floats
from policies.behaviour import Behaviour
from policies.behaviour.recovery import PARAMETERS_FILE, RecoveryParameters, searched_parameters
from policies.behaviour.transitions import State
from policies.parameters import number
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from train.search.evolution import Effort, last, minimise
from train.search.outcome import as_json, check, save
from train.search.trot_cost import Panel

LATE_COST = 2.0
"""What a robot that does not stand in time costs, in seconds of standing up late."""
TIMES = (0.05, 1.5)
"""Bounds of every blend and time, s; searched as their logarithms."""
THRESHOLDS = {
    "righted": (0.2, 0.8),
    "lost": (-0.2, 0.4),
    "caught": (1.0, 10.0),
    "kick_minimum": (0.05, 0.5),
    "upright": (0.2, 0.9),
}


@dataclass(frozen=True)
class Options(Effort):
    """Search the recovery's parameters."""

    generations: int = number(30, limits=(1, 10_000))
    """Rounds of the search."""
    candidates: int = number(24, limits=(4, 1000))
    """Parameter sets tried in a round."""
    starts: int = number(12, limits=(1, 10_000))
    """Random starts of each candidate in a round."""
    step: float = number(0.07, limits=(1e-6, 1.0))
    """First step size, rad and likewise in the other units."""
    out: Path = PARAMETERS_FILE
    """JSON to write."""


def main(options: Options) -> int:
    """Search and write; the exit code. Raises UsageError; KeyboardInterrupt, after what was found is kept."""
    check(options, options.out)
    save(options.out, as_json(last(search(options), lambda parameters: save(options.out, as_json(parameters)))))
    print(options.out)
    return 0


def search(options: Options) -> Iterator[RecoveryParameters]:
    """The mean of the search distribution after each generation."""

    def costs(points: list[Floats], generation: int) -> Floats:
        seeds = episode_seeds("search", 10_000 * (options.seed + 1) + generation, options.starts)
        return judge([decoded(point) for point in points], seeds, options.batch_threads)

    low, high = bounds()
    start = np.clip(encoded(searched_parameters()), low, high)
    for mean in minimise(options, start, (low, high), costs, spread=options.step, CMA_diagonal=True):
        yield decoded(np.clip(mean, low, high))


def judge(candidates: list[RecoveryParameters], seeds: NDArray[np.int64], threads: int) -> Floats:
    """Mean cost of each candidate, (candidates,): s until it stands, and more if that is late."""
    members = [Behaviour(start=State.RECOVER, follow=False, recovery=each) for each in candidates]
    outcome = recover_with(Panel(members), np.tile(seeds, len(candidates)), threads)
    time = np.minimum(outcome.standing_since, TIME_ALLOWED + 1.0)
    costs: Floats = (time + LATE_COST * (time > TIME_ALLOWED)).reshape(len(candidates), -1).mean(axis=1)
    return costs


def _scale(name: str) -> tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]]:
    """To the search's scale of a parameter, and back: times as logarithms, the turning speed by tens."""
    if name.endswith(("_blend", "_time")):
        return np.log, np.exp
    factor = 10.0 if name == "caught" else 1.0
    return (lambda values: values / factor), (lambda values: values * factor)


def encoded(parameters: RecoveryParameters) -> Floats:
    """The parameters as one vector, each on its scale of the search."""
    return np.concatenate([_scale(name)[0](np.atleast_1d(value)) for name, value in asdict(parameters).items()])


def decoded(vector: Floats) -> RecoveryParameters:
    """The parameters of a vector of `encoded`."""
    values: dict[str, Any] = {}
    place = 0
    for name, like in asdict(searched_parameters()).items():
        width = len(like) if isinstance(like, tuple) else 1
        rounded = tuple(round(float(value), 4) for value in _scale(name)[1](vector[place : place + width]))
        values[name] = rounded if isinstance(like, tuple) else rounded[0]
        place += width
    return RecoveryParameters(**values)


def bounds() -> tuple[Floats, Floats]:
    """Smallest and largest value of every entry of `encoded`."""
    legs = [np.tile(ends[:3], 2) for ends in (SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)]
    ends = {
        name: legs if isinstance(like, tuple) else THRESHOLDS.get(name, TIMES)
        for name, like in asdict(searched_parameters()).items()
    }
    low, high = (
        np.concatenate([_scale(name)[0](np.atleast_1d(both[end])) for name, both in ends.items()]) for end in (0, 1)
    )
    return low, high
