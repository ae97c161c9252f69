"""Search of `trot_feedback`'s gait and gains: `python -m train search feedback` writes its trot_feedback.json.

CMA-ES over `policies.trot.feedback_parameters.SEARCH_RANGES` from the defaults of `FeedbackParameters`; the account of
the search goes beside its outcome. A generation's candidates walk the same episodes side by side, and every
generation gets new ones, all from the "search" family of seeds. The outcome is adopted only where it is better than the
start on episodes of the "validation" family. After Ctrl-C what has been found so far stands in
trot_feedback.unjudged.json, and another search can go on from it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from evaluate.measures.metrics import Measures
from evaluate.statistics.significance import sign_flip_test
from policies.base import CONTROL_PERIOD, Floats
from policies.parameters import number
from policies.trot.feedback_parameters import PARAMETERS_FILE, SEARCH_RANGES, FeedbackParameters, read_parameters
from quad_env.seeding import episode_seeds
from train.search.evolution import EpisodeEffort, changes, encode, evolve, judged, last
from train.search.feedback_cost import COMMAND_INTERVAL, EXERCISES, FALL_COST, HISTORY, judge, walked
from train.search.outcome import as_json, check, save
from train.search.trot_cost import method

ACCOUNT = "TROT_FEEDBACK.md"
"""The account of a search, beside its outcome."""
UNJUDGED = ".unjudged.json"
"""Ending of the file that keeps parameters which have not been judged."""
SIGNIFICANT = 0.05
"""Largest p-value with which a smaller cost counts as smaller."""
ADOPTED, KEPT = "The outcome is adopted.", "The start is kept: the outcome is not better."
SHORTEST = round(2 * COMMAND_INTERVAL / CONTROL_PERIOD)
"""Shortest episode of the search, control steps."""
MOVED_MOST = 5
"""Parameters that an account names for having moved most."""


@dataclass(frozen=True)
class Options(EpisodeEffort):
    """Search the gait and the gains of trot_feedback."""

    generations: int = number(20, limits=(1, 10_000))
    """Rounds of the search."""
    candidates: int = number(16, limits=(4, 1000))
    """Parameter sets tried in a round."""
    episodes: int = number(4, limits=(1, 10_000))
    """Episodes a candidate and exercise."""
    steps: int = number(400, limits=(SHORTEST, 100_000))
    """Length of an episode, control steps of 10 ms."""
    spread: float = number(0.03, limits=(1e-6, 0.5))
    """First standard deviation of a parameter, as a share of its range."""
    check_episodes: int = number(64, limits=(1, 10_000))
    """Full episodes an exercise, of validation seeds, on which the outcome is judged beside the start."""
    start: Path | None = None
    """Parameters to start from, JSON; by default the defaults in the code."""
    out: Path = PARAMETERS_FILE
    """Where the parameters go, JSON; the account of the search goes beside it, TROT_FEEDBACK.md."""


def search(options: Options, start: FeedbackParameters) -> Iterator[FeedbackParameters]:
    """The mean of the search distribution after each generation, to four digits."""

    def costs(candidates: list[FeedbackParameters], seeds: NDArray[np.int64]) -> Floats:
        return judge(candidates, seeds, options.steps, options.batch_threads)

    return evolve(options, start, SEARCH_RANGES, costs, spread=options.spread, digits=4)


@dataclass(frozen=True)
class Comparison:
    """The start and the outcome of a search on the same fresh episodes, of validation seeds and on its ground."""

    walks: tuple[tuple[str, str, Measures], ...]
    """Exercise, `before` for the start or `after` for the outcome, and what it measures there."""
    differences: Floats
    """Cost of the outcome less that of the start, summed over the exercises, of each seed, (seeds,)."""

    @property
    def p_value(self) -> float:
        """p-value of the mean difference, two-sided, by flips of its signs."""
        return sign_flip_test(self.differences)

    @property
    def better(self) -> bool:
        """Whether the outcome costs less than the start, by more than chance would have it."""
        return bool(self.differences.mean() < 0.0) and self.p_value <= SIGNIFICANT

    @property
    def verdict(self) -> str:
        """What follows from it, in words."""
        difference = float(self.differences.mean())
        return (
            f"**{ADOPTED if self.better else KEPT}** On {len(self.differences)} validation seeds, 10 s an exercise, "
            f"the outcome costs {abs(difference):.3g} {'less' if difference < 0.0 else 'more'} than the start a seed, "
            f"p = {self.p_value:.2g}; it is adopted where it costs less with p of at most {SIGNIFICANT:g}."
        )


def compared(options: Options, start: FeedbackParameters, outcome: FeedbackParameters) -> Comparison:
    """Both judged on episodes that the search has not seen."""
    seeds = episode_seeds("validation", options.seed, options.check_episodes)
    walks, differences = [], np.zeros(len(seeds))
    for exercise in track(EXERCISES, description="judging"):
        before, after = (walked([each], exercise, seeds, options.threads) for each in (start, outcome))
        walks += [(exercise.name, "before", before), (exercise.name, "after", after)]
        differences += exercise.bill(after) - exercise.bill(before)
    return Comparison(tuple(walks), differences)


def account(options: Options, start: FeedbackParameters, outcome: FeedbackParameters, found: Comparison) -> str:
    """What the search found, what it is worth on fresh episodes and what follows from that, as Markdown."""
    command = (
        f"python -m train search feedback --seed {options.seed} --generations {options.generations} "
        f"--candidates {options.candidates} --episodes {options.episodes} --steps {options.steps} "
        f"--spread {options.spread:g} --check-episodes {options.check_episodes}"
        + (f" --start {options.start}" if options.start else "")
    )
    billed = f"Falls cost {FALL_COST:g} more on {', '.join(each.name for each in EXERCISES if each.fall_cost)}."
    lines = [
        "# The parameters of trot_feedback",
        "",
        *method(command, options, {exercise.name: exercise.weight for exercise in EXERCISES}),
        billed,
        HISTORY,
        "",
        found.verdict,
        moved(start, outcome),
        "",
        *changes(start, outcome, SEARCH_RANGES),
        "",
        *judged("exercise", found.walks),
    ]
    return "\n".join(lines) + "\n"


def moved(start: FeedbackParameters, outcome: FeedbackParameters) -> str:
    """How far the search moved the parameters, in words."""
    shares = np.abs(encode(outcome, SEARCH_RANGES) - encode(start, SEARCH_RANGES))
    order = np.argsort(-shares, kind="stable")[:MOVED_MOST]
    most = ", ".join(f"{list(SEARCH_RANGES)[place]} ({shares[place]:.1%})" for place in order)
    return f"The search moved parameters by {np.median(shares):.1%} of their range in the median, most of all {most}."


def main(options: Options) -> int:
    """Search, judge, write; the exit code. Raises UsageError; KeyboardInterrupt, after what was found is kept aside."""
    check(options, options.out, ACCOUNT)
    start = read_parameters(options.start) if options.start else FeedbackParameters()
    aside = options.out.with_suffix(UNJUDGED)
    outcome = last(search(options, start), lambda parameters: save(aside, as_json(parameters)))
    try:
        found = compared(options, start, outcome)
    except KeyboardInterrupt:
        save(aside, as_json(outcome))
        raise KeyboardInterrupt("kept what was found, not judged") from None
    try:
        save(options.out, as_json(outcome if found.better else start))
    finally:
        save(options.out.with_name(ACCOUNT), account(options, start, outcome, found), show=True)
    return 0
