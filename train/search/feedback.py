"""Search of `trot_feedback`'s gait and gains: `python -m train search feedback` writes its trot_feedback.json.

CMA-ES over `policies.trot.feedback_parameters.SEARCH_RANGES` from the defaults of `FeedbackParameters`; the account of
the search goes beside its outcome. A generation's candidates walk the same episodes side by side, and every
generation gets new ones, all from the "search" family of seeds. Ctrl-C keeps what has been found so far, and another
search can go on from it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD
from policies.trot.feedback_parameters import PARAMETERS_FILE, SEARCH_RANGES, FeedbackParameters, read_parameters
from quad_env.seeding import episode_seeds
from train.search.evolution import changes, evolve, judged, last
from train.search.feedback_cost import COMMAND_INTERVAL, EXERCISES, FALL_COST, judge, walked
from train.search.outcome import as_json, check_numbers, check_output, save
from train.search.trot import LIMITS as TROT_LIMITS
from train.search.trot_cost import ERROR_SCALES, Floats

ACCOUNT = "TROT_FEEDBACK.md"
"""The account of a search, beside its outcome."""
LIMITS = {name: TROT_LIMITS[name] for name in ("generations", "candidates", "episodes", "seed", "threads")} | {
    "steps": (round(2 * COMMAND_INTERVAL / CONTROL_PERIOD), 100_000),
    "check_episodes": (1, 10_000),
    "spread": (1e-6, 0.5),
}
"""Smallest and largest value of each number of the options."""


@dataclass(frozen=True)
class Options:
    """Search the gait and the gains of trot_feedback."""

    generations: int = 8
    """Rounds of the search."""
    candidates: int = 16
    """Parameter sets tried in a round."""
    episodes: int = 8
    """Episodes a candidate and exercise."""
    steps: int = 500
    """Length of an episode, control steps of 10 ms."""
    spread: float = 0.01
    """First standard deviation of a parameter, as a share of its range."""
    check_episodes: int = 64
    """Fresh full episodes an exercise on which the outcome is judged beside the parameters before the search."""
    seed: int = 0
    """Seed of the search."""
    threads: int = 2
    """Threads of the simulation."""
    start: Path | None = None
    """Parameters to start from, JSON; by default the defaults in the code."""
    out: Path = PARAMETERS_FILE
    """Where the parameters go, JSON; the account of the search goes beside it, TROT_FEEDBACK.md."""


def search(options: Options, start: FeedbackParameters) -> Iterator[FeedbackParameters]:
    """The mean of the search distribution after each generation, to four digits."""

    def costs(candidates: list[FeedbackParameters], seeds: NDArray[np.int64]) -> Floats:
        return judge(candidates, seeds, options.steps, options.threads)

    return evolve(options, start, SEARCH_RANGES, costs, spread=options.spread, digits=4)


def account(options: Options, before: FeedbackParameters, after: FeedbackParameters) -> str:
    """What the search found and what it is worth on fresh episodes, as Markdown."""
    command = (
        f"python -m train search feedback --seed {options.seed} --generations {options.generations} "
        f"--candidates {options.candidates} --episodes {options.episodes} --steps {options.steps} "
        f"--spread {options.spread:g}" + (f" --start {options.start}" if options.start else "")
    )
    lines = [
        "# The parameters of trot_feedback",
        "",
        f"Written by `{command}`: CMA-ES, {options.generations} "
        f"generations of {options.candidates} candidates, {options.episodes} episodes of "
        f"{options.steps * CONTROL_PERIOD:g} s a candidate on each of "
        f"{', '.join(f'{exercise.name} (weight {exercise.weight:g})' for exercise in EXERCISES)}.",
        "Cost of an episode: "
        + " + ".join(f"{name} / {scale:g}" for name, scale in ERROR_SCALES.items())
        + "; falls are billed within the errors, and "
        f"{FALL_COST:g} more on {', '.join(exercise.name for exercise in EXERCISES if exercise.fall_cost)}.",
        "",
        *changes(before, after, SEARCH_RANGES),
    ]
    return "\n".join((*lines, "", *comparison(options, before, after))) + "\n"


def comparison(options: Options, before: FeedbackParameters, after: FeedbackParameters) -> list[str]:
    """Both judged on fresh episodes, as lines of Markdown."""
    seeds = episode_seeds("search", options.seed + 1_000_000, options.check_episodes)
    walks = (
        (exercise.name, label, walked([parameters], exercise, seeds, options.threads))
        for exercise in EXERCISES
        for label, parameters in (("before", before), ("after", after))
    )
    lead = f"On {options.check_episodes} fresh search episodes of 10 s an exercise:"
    return [lead, "", *judged("exercise", walks, 2 * len(EXERCISES))]


def main(options: Options) -> int:
    """Search, write, judge; the exit code. Raises UsageError; KeyboardInterrupt, after what was found is kept."""
    check_numbers(options, LIMITS)
    check_output(options.out, ACCOUNT)
    before = read_parameters(options.start) if options.start else FeedbackParameters()
    found = last(search(options, before), lambda parameters: save(options.out, as_json(parameters)))
    try:
        save(options.out, as_json(found))
    finally:
        save(options.out.with_name(ACCOUNT), account(options, before, found), show=True)
    return 0
