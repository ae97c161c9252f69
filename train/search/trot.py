"""Search of the trot's parameters: `python -m train search trot` writes trot.json and TROT.md in policies/trot.

CMA-ES over `policies.trot.open_loop.SEARCH_RANGES`. A generation's candidates walk the same episodes side by side,
and every generation gets new ones, all from the "search" family of seeds, which neither training nor evaluation draws.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from evaluate.measures.metrics import measure
from evaluate.measures.tracking import SETTLING_TIME
from evaluate.rollouts.rollout import run
from policies.base import CONTROL_PERIOD, Floats
from policies.parameters import number
from policies.trot.open_loop import PARAMETERS_FILE, SEARCH_RANGES, Trot, TrotParameters
from quad_env.seeding import episode_seeds
from train.scenarios import practice
from train.search.evolution import EpisodeEffort, changes, evolve, judged, rounded
from train.search.outcome import as_json, check, save
from train.search.trot_cost import MINIMUM_INTERVALS, SCENARIO_WEIGHTS, judge, mapped, method

COMMAND_MAP = ("forward_gain", "forward_bias", "lateral_gain", "yaw_gain", "yaw_per_lateral")
SPREAD = 0.15
"""First standard deviation of a parameter, as a share of its range."""
MAP_ROUNDS = 3
"""How often the command map is fitted again with the one before in force."""
ACCOUNT = "TROT.md"
"""The account of a search, beside its outcome."""
SHORTEST = round(SETTLING_TIME / CONTROL_PERIOD) + 1
"""Shortest episode, control steps: what is settling only is not judged."""


@dataclass(frozen=True)
class Options(EpisodeEffort):
    """Search the trot's parameters."""

    generations: int = number(14, limits=(1, 10_000))
    """Rounds of the search."""
    candidates: int = number(14, limits=(4, 1000))
    """Parameter sets tried in a round."""
    episodes: int = number(10, limits=(1, 10_000))
    """Episodes a candidate and scenario."""
    steps: int = number(600, limits=(SHORTEST, 100_000))
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int = number(108, limits=(MINIMUM_INTERVALS // 2, 10_000))  # of two command intervals each
    """Fresh episodes a scenario on which the outcome is judged beside the parameters before the search."""
    out: Path = PARAMETERS_FILE
    """Where the parameters go, JSON; the account of the search goes beside it, TROT.md."""


def search(options: Options, start: TrotParameters) -> TrotParameters:
    """The mean of the search distribution after the last generation, its command map fitted, to four digits."""

    def costs(candidates: list[TrotParameters], seeds: NDArray[np.int64]) -> Floats:
        return judge(candidates, seeds, options.steps, options.batch_threads)

    *_, found = evolve(options, start, SEARCH_RANGES, costs, spread=SPREAD)
    fresh = episode_seeds("search", options.seed + 2_000_000, MAP_ROUNDS * options.check_episodes)
    for round_seeds in track(np.split(fresh, MAP_ROUNDS), description="command map"):
        found = mapped(found, round_seeds, options.threads)
    return rounded(found)


def account(options: Options, before: TrotParameters, after: TrotParameters) -> str:
    """What the search found and what it is worth on fresh episodes, as Markdown."""
    lines = [
        "# The trot's parameters",
        "",
        *method(f"python -m train search trot --seed {options.seed}", options, SCENARIO_WEIGHTS),
        "Each candidate is judged against its own linear response on flat ground; the command map is fitted by least "
        "squares afterwards.",
        "",
        *changes(before, after, SEARCH_RANGES, COMMAND_MAP),
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


def main(options: Options) -> int:
    """Search, write, judge; the exit code. Raises UsageError."""
    check(options, options.out, ACCOUNT)
    before = TrotParameters()
    after = search(options, before)
    try:
        save(options.out, as_json(after))
    finally:
        save(options.out.with_name(ACCOUNT), account(options, before, after), show=True)
    return 0
