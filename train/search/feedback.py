"""Search of `trot_feedback`'s gait and gains: `python -m train search feedback` writes its trot_feedback.json.

CMA-ES over `policies.trot.feedback_parameters.SEARCH_RANGES` from the defaults of `FeedbackParameters`; the account of
the search goes beside its outcome. A generation's candidates walk the same episodes side by side, and every
generation gets new ones, all from the "search" family of seeds. Ctrl-C keeps what has been found so far, and another
search can go on from it.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evaluate.terminal import launcher
from evaluate.terminal.command_line import UsageError, fail, parse, survive_narrow_encodings
from policies.base import CONTROL_PERIOD
from policies.trot.feedback_parameters import PARAMETERS_FILE, SEARCH_RANGES, FeedbackParameters, read_parameters
from quad_env.seeding import episode_seeds
from train.search.evolution import changes, evolve, judged
from train.search.feedback_cost import COMMAND_INTERVAL, EXERCISES, FALL_COST, judge, walked
from train.search.trot import LIMITS as TROT_LIMITS
from train.search.trot import check_numbers, check_output, keep
from train.search.trot_cost import ERROR_SCALES, Floats

ACCOUNT = "TROT_FEEDBACK.md"
"""The account of a search, beside its outcome."""
LIMITS = {name: TROT_LIMITS[name] for name in ("generations", "candidates", "episodes", "seed", "threads")} | {
    "steps": (round(2 * COMMAND_INTERVAL / CONTROL_PERIOD), 100_000),
    "check_episodes": (1, 10_000),
}
"""Smallest and largest value of each number of the options."""


@dataclass(frozen=True)
class SearchOptions:
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


def search(options: SearchOptions, start: FeedbackParameters) -> Iterator[FeedbackParameters]:
    """The mean of the search distribution after each generation, to four digits."""

    def costs(candidates: list[FeedbackParameters], seeds: NDArray[np.int64]) -> Floats:
        return judge(candidates, seeds, options.steps, options.threads)

    return evolve(options, start, SEARCH_RANGES, costs, spread=options.spread, digits=4)


def account(options: SearchOptions, done: int, before: FeedbackParameters, after: FeedbackParameters) -> str:
    """What the search found and what it is worth on fresh episodes, as Markdown."""
    command = (
        f"python -m train search feedback --seed {options.seed} --generations {options.generations} "
        f"--candidates {options.candidates} --episodes {options.episodes} --steps {options.steps} "
        f"--spread {options.spread:g}" + (f" --start {options.start}" if options.start else "")
    )
    lines = [
        "# The parameters of trot_feedback",
        "",
        f"Written by `{command}`: CMA-ES, {done} "
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


def comparison(options: SearchOptions, before: FeedbackParameters, after: FeedbackParameters) -> list[str]:
    """Both judged on fresh episodes, as lines of Markdown."""
    seeds = episode_seeds("search", options.seed + 1_000_000, options.check_episodes)
    walks = (
        (exercise.name, label, walked([parameters], exercise, seeds, options.threads))
        for exercise in EXERCISES
        for label, parameters in (("before", before), ("after", after))
    )
    lead = f"On {options.check_episodes} fresh search episodes of 10 s an exercise:"
    return [lead, "", *judged("exercise", walks)]


def main(arguments: list[str] | None = None) -> int:
    """Search, judge, write; the exit code: 0, 2 on bad input or an outcome that cannot be written, 130 after Ctrl-C."""
    survive_narrow_encodings()
    try:
        options = parse(
            SearchOptions, arguments, program="python -m train search feedback", description="Search trot_feedback."
        )
        check_numbers(options, LIMITS)
        if not 0.0 < options.spread <= 0.5:
            raise UsageError(f"--spread must be above 0 and at most 0.5, got {options.spread:g}")
        check_output(options.out, ACCOUNT)
        before = read_parameters(options.start) if options.start else FeedbackParameters()
    except (UsageError, ValueError) as error:
        return fail(str(error))
    return find(options, before)


def find(options: SearchOptions, before: FeedbackParameters) -> int:
    """Search and write what was found, after Ctrl-C too; the exit code."""
    found, done, complaint = before, 0, ""
    try:
        for better in search(options, before):
            found, done = better, done + 1
        complaint = keep(options.out, json.dumps(asdict(found), indent=2) + "\n")
        text = account(options, done, before, found)
        complaint = keep(options.out.with_name(ACCOUNT), text, show=True) or complaint
    except KeyboardInterrupt:
        if done:
            keep(options.out, json.dumps(asdict(found), indent=2) + "\n")
        print(f"stopped after {done} generations; not judged", file=sys.stderr)
        return launcher.INTERRUPTED
    return fail(complaint) if complaint else 0


if __name__ == "__main__":
    raise SystemExit(main())
