"""Search of the trot's parameters: `python -m train search trot` writes trot.json and TROT.md in policies/trot, for
another robot in the robot's own folder, beginning with SimpleQuad's by dynamic similarity.

CMA-ES over `policies.trot.open_loop.SEARCH_RANGES`. A generation's candidates walk the same episodes side by side,
and every generation gets new ones, all from the "search" family of seeds, which neither training nor evaluation draws.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from evaluate.measures.tracking import SETTLING_TIME
from evaluate.rollouts.hardware import IDEAL, Hardware, hardware_of
from policies.base import CONTROL_PERIOD, Floats
from policies.parameters import number, scaled_parameters, scaled_ranges
from policies.trot.open_loop import PARAMETERS_FILE, SEARCH_RANGES, TrotParameters, searched_parameters
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from train.search.evolution import EpisodeEffort, Ranges, changes, evolve, judged, rounded
from train.search.outcome import as_json, check, own_folder, save
from train.search.trot_cost import MINIMUM_INTERVALS, SCENARIO_WEIGHTS, judge, mapped, method, walked

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
    episodes: int = number(10, limits=(MINIMUM_INTERVALS, 10_000))  # else no response can be fitted
    """Episodes a candidate and scenario."""
    steps: int = number(600, limits=(SHORTEST, 100_000))
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int = number(108, limits=(MINIMUM_INTERVALS // 2, 10_000))  # of two command intervals each
    """Fresh episodes a scenario on which the outcome is judged beside the parameters before the search."""
    robot: str = "simple_quad"
    """Robot that walks: a name of quad_env.ROBOTS such as go1, or the path of its MJCF or TOML."""
    out: Path | None = None
    """Where the parameters go, JSON; the account of the search goes beside it, TROT.md. By default to where the robot's
    trot has them from: beside its code for SimpleQuad, else in the robot's folder."""

    @property
    def hardware(self) -> Hardware:
        """The robot, its motors and sensors as they come."""
        return Hardware(robot=self.robot)

    @property
    def command(self) -> str:
        """The command that repeats the search."""
        told = [f"--seed {self.seed}"] + [f"--robot {self.robot}"] * (self.hardware != IDEAL)
        return " ".join(["python -m train search trot", *told])


def search(options: Options, start: TrotParameters) -> TrotParameters:
    """The mean of the search distribution after the last generation, its command map fitted, to four digits."""

    def costs(candidates: list[TrotParameters], seeds: NDArray[np.int64]) -> Floats:
        return judge(candidates, seeds, options.steps, options.batch_threads, options.hardware)

    *_, found = evolve(options, start, ranges(options), costs, spread=SPREAD)
    fresh = episode_seeds("search", options.seed + 2_000_000, MAP_ROUNDS * options.check_episodes)
    for round_seeds in track(np.split(fresh, MAP_ROUNDS), description="command map"):
        found = mapped(found, round_seeds, options.threads, options.hardware)
    return rounded(found)


def ranges(options: Options) -> Ranges:
    """Bounds of the robot's search."""
    return scaled_ranges(SEARCH_RANGES, TrotParameters, options.hardware.quadruped)


def account(options: Options, before: TrotParameters, after: TrotParameters) -> str:
    """What the search found and what it is worth on fresh episodes, as Markdown."""
    lines = [
        "# The trot's parameters",
        "",
        *method(options.command, options, SCENARIO_WEIGHTS),
        "Each candidate is judged against its own linear response on flat ground; the command map is fitted by least "
        "squares afterwards.",
        "",
        *changes(before, after, ranges(options), COMMAND_MAP),
        "",
        f"On {options.check_episodes} fresh search episodes of 10 s a scenario:",
        "",
    ]
    seeds = episode_seeds("search", options.seed + 1_000_000, options.check_episodes)
    walks = (
        (name, label, walked(parameters, name, seeds, options.threads, options.hardware))
        for name in SCENARIO_WEIGHTS
        for label, parameters in (("before", before), ("after", after))
    )
    lines += judged("scenario", track(walks, description="judging", total=2 * len(SCENARIO_WEIGHTS)))
    return "\n".join(lines) + "\n"


def main(options: Options) -> int:
    """Search, write, judge; the exit code. Raises UsageError."""
    robot = hardware_of(options.robot).quadruped
    own = robot == SIMPLE_QUAD
    out = options.out or (PARAMETERS_FILE if own else own_folder(robot) / PARAMETERS_FILE.name)
    check(options, out, ACCOUNT)
    before = TrotParameters() if own else scaled_parameters(searched_parameters(), robot)
    after = search(options, before)
    try:
        save(out, as_json(after))
    finally:
        save(out.with_name(ACCOUNT), account(options, before, after), show=True)
    return 0
