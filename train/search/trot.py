"""Search of the trot's parameters: `python -m train search trot` writes trot.json and TROT.md in policies/trot.

CMA-ES over `policies.trot.open_loop.SEARCH_RANGES`. A generation's candidates walk the same episodes side by side,
and every generation gets new ones, all from the "search" family of seeds, which neither training nor evaluation draws.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from evaluate.measures.metrics import SETTLING_TIME, measure
from evaluate.rollouts.rollout import run
from evaluate.terminal.command_line import check_numbers
from policies.base import CONTROL_PERIOD
from policies.trot.open_loop import PARAMETERS_FILE, SEARCH_RANGES, Trot, TrotParameters
from quad_env.seeding import episode_seeds
from train.scenarios import practice
from train.search.evolution import changes, evolve, judged
from train.search.outcome import as_json, check_output, save
from train.search.trot_cost import ERROR_SCALES, MINIMUM_INTERVALS, SCENARIO_WEIGHTS, Floats, judge, mapped

COMMAND_MAP = ("forward_gain", "forward_bias", "lateral_gain", "yaw_gain", "yaw_per_lateral")
SPREAD = 0.15
"""First standard deviation of a parameter, as a share of its range."""
MAP_ROUNDS = 3
"""How often the command map is fitted again with the one before in force."""
ACCOUNT = "TROT.md"
"""The account of a search, beside its outcome."""
LIMITS = {
    "generations": (1, 10_000),
    "candidates": (4, 1000),
    "episodes": (1, 10_000),
    "steps": (round(SETTLING_TIME / CONTROL_PERIOD) + 1, 100_000),  # what is settling only is not judged
    "check_episodes": (MINIMUM_INTERVALS // 2, 10_000),  # of two command intervals each
    "seed": (0, 2**31),
    "threads": (1, 256),
}
"""Smallest and largest value of each number of the options."""


@dataclass(frozen=True)
class Options:
    """Search the trot's parameters."""

    generations: int = 14
    """Rounds of the search."""
    candidates: int = 14
    """Parameter sets tried in a round."""
    episodes: int = 10
    """Episodes a candidate and scenario."""
    steps: int = 600
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int = 108
    """Fresh episodes a scenario on which the outcome is judged beside the parameters before the search."""
    seed: int = 0
    """Seed of the search."""
    threads: int = 2
    """Threads of the simulation."""
    out: Path = PARAMETERS_FILE
    """Where the parameters go, JSON; the account of the search goes beside it, TROT.md."""


def search(options: Options, start: TrotParameters) -> TrotParameters:
    """The mean of the search distribution after the last generation, its command map fitted, to four digits."""

    def costs(candidates: list[TrotParameters], seeds: NDArray[np.int64]) -> Floats:
        return judge(candidates, seeds, options.steps, options.threads)

    *_, found = evolve(options, start, SEARCH_RANGES, costs, spread=SPREAD)
    fresh = episode_seeds("search", options.seed + 2_000_000, MAP_ROUNDS * options.check_episodes)
    for round_seeds in track(np.split(fresh, MAP_ROUNDS), description="command map"):
        found = mapped(found, round_seeds, options.threads)
    return TrotParameters(**{name: round(value, 4) for name, value in asdict(found).items()})


def account(options: Options, before: TrotParameters, after: TrotParameters) -> str:
    """What the search found and what it is worth on fresh episodes, as Markdown."""
    lines = [
        "# The trot's parameters",
        "",
        f"Written by `python -m train search trot --seed {options.seed}`: CMA-ES, {options.generations} generations of "
        f"{options.candidates} candidates, {options.episodes} episodes of {options.steps * CONTROL_PERIOD:g} s a "
        "candidate on each of "
        f"{', '.join(f'{name} (weight {weight:g})' for name, weight in SCENARIO_WEIGHTS.items())}.",
        "Cost of an episode: "
        + " + ".join(f"{name} / {scale:g}" for name, scale in ERROR_SCALES.items())
        + "; falls are billed within the errors. Each candidate is judged against its own linear response on flat "
        "ground; the command map is fitted by least squares afterwards.",
        "",
        *changes(before, after, SEARCH_RANGES, COMMAND_MAP),
    ]
    lines += [
        "",
        f"On {options.check_episodes} fresh search episodes of 10 s a scenario:",
        "",
    ]
    seeds = episode_seeds("search", options.seed + 1_000_000, options.check_episodes)
    walks = (
        (name, label, measure(run(Trot(parameters), practice(name, "search"), seeds, nthread=options.threads)))
        for name in SCENARIO_WEIGHTS
        for label, parameters in (("before", before), ("after", after))
    )
    lines += judged("scenario", track(walks, description="judging", total=2 * len(SCENARIO_WEIGHTS)))
    return "\n".join(lines) + "\n"


def check(options: Options) -> None:
    """Raise UsageError, one line, on options that no search can be made with."""
    check_numbers(options, LIMITS)
    check_output(options.out, ACCOUNT)


def main(options: Options) -> int:
    """Search, write, judge; the exit code. Raises UsageError."""
    check(options)
    before = TrotParameters()
    after = search(options, before)
    try:
        save(options.out, as_json(after))
    finally:
        save(options.out.with_name(ACCOUNT), account(options, before, after), show=True)
    return 0
