"""Search of a gait's numbers: `python -m train search gait --gait bound` writes its part of policies/gaits/gaits.json.

CMA-ES over the gait's ranges, from the numbers in force. A generation's candidates walk the same episodes side by side,
and every generation gets new ones, all from the "search" family of seeds, which neither training nor evaluation draws.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from policies.gaits.parameters import OFFSETS, PARAMETERS_FILE, GaitParameters, searched_parameters
from policies.parameters import number
from quad_env.cli.command_line import UsageError
from quad_env.seeding import episode_seeds
from train.search.command_map import response, undone
from train.search.evolution import EpisodeEffort, Ranges, evolve, rounded
from train.search.gait_cost import FEWEST, SETTLING, commands, cost, shared_walk
from train.search.outcome import as_json, check, save

_COMMON = {
    "frequency": (2.0, 3.6),
    "frequency_rise": (0.0, 1.5),
    "duty": (0.5, 0.65),
    "duty_fall": (0.0, 0.1),
    "body_height": (0.24, 0.44),
    "step_height": (0.04, 0.14),
    "stance_width": (0.4, 0.6),
    "stance_shift": (-0.15, 0.05),
    "servo_lead": (0.0, 0.04),
    "stance_load": (0.0, 1.5),
}
RANGES: dict[str, Ranges] = {
    "trot": _COMMON,
    "walk": _COMMON
    | {
        "frequency": (1.0, 2.2),
        "duty": (0.76, 0.82),
        "duty_fall": (0.0, 0.005),
        "stance_width": (0.4, 0.7),
        "sway": (0.0, 0.08),
    },
    "pace": _COMMON | {"sway": (0.0, 0.05), "frequency": (2.2, 3.6), "stance_width": (0.3, 0.6), "bounce": (0.0, 1.2)},
    "bound": _COMMON | {"frequency": (2.0, 3.2), "duty": (0.42, 0.52), "bounce": (0.0, 1.5)},
    "pronk": _COMMON | {"frequency": (1.8, 3.2), "duty": (0.45, 0.65), "bounce": (0.3, 1.4)},
}
"""Bounds of each gait's search by field name."""
MAP_ROUNDS = 3
"""How often the command map is fitted again with the one before in force."""
MAP_EPISODES = 64


@dataclass(frozen=True, kw_only=True)
class Options(EpisodeEffort):
    """Search a gait's numbers."""

    gait: str
    """Gait to search: bound, pace, pronk, trot or walk."""
    generations: int = number(20, limits=(0, 10_000))
    """Rounds of the search; 0 fits the command map alone."""
    spread: float = number(0.15, limits=(0.001, 0.5))
    """Standard deviation of the first candidates, in widths of the ranges."""
    candidates: int = number(10, limits=(4, 1000))
    """Parameter sets tried in a round."""
    episodes: int = number(10, limits=(FEWEST, 10_000))
    """Episodes a candidate."""
    steps: int = number(400, limits=(SETTLING + 100, 100_000))
    """Length of an episode, control steps of 10 ms."""
    out: Path = PARAMETERS_FILE
    """File of all gaits' parameters, JSON, in which this gait's are replaced."""


def search(options: Options, start: GaitParameters) -> GaitParameters:
    """The mean of the search distribution after the last generation."""

    def costs(candidates: list[GaitParameters], seeds: NDArray[np.int64]) -> list[float]:
        command = commands(options.gait, options.episodes, np.random.default_rng(seeds))
        walks = shared_walk(options.gait, candidates, command, seeds, options.steps, options.batch_threads)
        return [cost(walk, command) for walk in walks]

    ranges = RANGES[options.gait]
    *_, found = evolve(options, start, ranges, costs, spread=options.spread, description=options.gait)
    return found


def fitted(options: Options, found: GaitParameters) -> GaitParameters:
    """The parameters with a command map fitted on fresh episodes, to four digits."""
    rng = np.random.default_rng((1, options.seed))
    for done in track(range(MAP_ROUNDS), description="command map"):
        command = commands(options.gait, MAP_EPISODES, rng)
        seeds = episode_seeds("search", options.seed + 1_000_000 + done, MAP_EPISODES)
        (walk,) = shared_walk(options.gait, [found], command, seeds, 2 * options.steps, options.threads)
        upright = ~walk.fell
        if upright.sum() < FEWEST:
            raise UsageError(f"the {options.gait} falls: {int(walk.fell.sum())} of {MAP_EPISODES}; search on")
        found = undone(found, response(command[upright], walk.heading_velocity.mean(axis=0)[upright]))
    return rounded(found)


def main(options: Options) -> int:
    """Search and write; the exit code. Raises UsageError."""
    if options.gait not in OFFSETS:
        raise UsageError(f"--gait must be one of {', '.join(OFFSETS)}, got {options.gait}")
    check(options, options.out)
    start = searched_parameters()[options.gait]
    found = fitted(options, search(options, start) if options.generations else start)
    gaits = searched_parameters() | {options.gait: found}
    save(options.out, json.dumps({name: asdict(gaits[name]) for name in sorted(OFFSETS)}, indent=2) + "\n")
    print(as_json(found), end="")
    return 0
