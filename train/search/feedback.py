"""Search of a policy that feels for success: `python -m train search feedback [--policy trot_integral]`.

CMA-ES over the gait and the gains, from those in force; the outcome and the account of the search go beside the policy,
and so does every trial, as soon as its generation is judged.
A generation's candidates walk the same episodes side by side, and every generation gets new ones, all from the "search"
family of seeds. The outcome is adopted only where it is better than those in force on episodes of the "validation"
family. With the defaults it takes 26 minutes of processor time, for mpc_wbc thrice as much. After Ctrl-C what has been
found so far stands in a file that ends in .unjudged.json, and another search can go on from it.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.tracking import SETTLING_TIME
from policies.base import CONTROL_PERIOD, Floats, Policy
from policies.mpc import parameters as mpc_parameters
from policies.parameters import Parameters, number
from policies.residual_bases import BASES
from policies.trot import feedback_parameters, integral
from quad_env.seeding import episode_seeds
from train.search.evolution import EpisodeEffort, Ranges, changes, evolve, judged, last
from train.search.feedback_comparison import Comparison, compared, moved
from train.search.feedback_cost import EXERCISES, WORDS, judge
from train.search.outcome import as_json, check, save
from train.setting_ranges import check_scenarios

UNJUDGED = ".unjudged.json"
"""Ending of the file that keeps parameters which have not been judged."""
TRIALS = ".trials.jsonl"
"""Ending of the file of all trials: a line a generation, with the mean of the distribution after it."""
SHORTEST = round(SETTLING_TIME / CONTROL_PERIOD) + 1
"""Shortest episode, control steps: what is settling only is not judged."""


@dataclass(frozen=True)
class Subject:
    """A policy that is searched."""

    read: Callable[[Path], Parameters]
    """Its parameters from a file. Raises PolicyError."""
    file: Path
    """Where they stand that are in force, JSON."""
    ranges: Ranges

    @property
    def account(self) -> str:
        """Name of the account of a search, beside its outcome."""
        return f"{self.file.stem.upper()}.md"


SUBJECTS = {
    "mpc_wbc": Subject(mpc_parameters.read_parameters, mpc_parameters.PARAMETERS_FILE, mpc_parameters.SEARCH_RANGES),
    "trot_feedback": Subject(
        feedback_parameters.read_parameters, feedback_parameters.PARAMETERS_FILE, feedback_parameters.SEARCH_RANGES
    ),
    "trot_integral": Subject(integral.read_parameters, integral.PARAMETERS_FILE, integral.SEARCH_RANGES),
}
"""By name of the policy."""


@dataclass(frozen=True)
class Options(EpisodeEffort):
    """Search the gait and the gains of a policy that feels: 26 minutes of processor time, for mpc_wbc thrice that."""

    policy: Literal["mpc_wbc", "trot_feedback", "trot_integral"] = "trot_feedback"
    """Whose parameters are searched."""
    generations: int = number(22, limits=(1, 10_000))
    """Rounds of the search."""
    candidates: int = number(16, limits=(4, 1000))
    """Parameter sets tried in a round."""
    exercises: tuple[str, ...] = EXERCISES
    """Scenarios on which candidates and the outcome are judged, all of one weight, such as flat push=42."""
    episodes: int = number(1, limits=(1, 10_000))
    """Episodes a candidate and exercise."""
    steps: int = number(500, limits=(SHORTEST, 100_000))
    """Length of an episode, control steps of 10 ms: by default a single command."""
    spread: float = number(0.15, limits=(1e-6, 0.5))
    """First standard deviation of a parameter, as a share of its range."""
    check_episodes: int = number(32, limits=(1, 10_000))
    """Full episodes an exercise, of validation seeds, on which the outcome is judged beside those in force."""
    start: Path | None = None
    """Parameters to start from, JSON; by default those in force."""
    out: Path | None = None
    """Where the parameters go, JSON; the account of the search goes beside it. By default beside the policy's code."""

    @property
    def subject(self) -> Subject:
        """What is searched."""
        return SUBJECTS[self.policy]

    @property
    def command(self) -> str:
        """The command that repeats the search."""
        return (
            f"python -m train search feedback --policy {self.policy} --seed {self.seed} "
            f"--generations {self.generations} --candidates {self.candidates} --episodes {self.episodes} "
            f"--steps {self.steps} --spread {self.spread:g} --check-episodes {self.check_episodes}"
            + (f" --exercises {' '.join(self.exercises)}" if self.exercises != EXERCISES else "")
            + (f" --start {self.start}" if self.start else "")
        )

    def made(self, parameters: Sequence[Parameters]) -> list[Policy]:
        """The policy with each of those parameters."""
        return [BASES[self.policy].make(parameters=each) for each in parameters]


def search(options: Options, start: Parameters, trials: Path) -> Iterator[Parameters]:
    """The mean of the search distribution after each generation, to four digits; `trials` gets all that was tried."""
    ranges, lines, tried = options.subject.ranges, list[str](), list[dict[str, float]]()

    def costs(candidates: list[Parameters], seeds: NDArray[np.int64]) -> Floats:
        found = judge(options.made(candidates), options.exercises, seeds, options.steps, options.batch_threads)
        searched = ({name: getattr(each, name) for name in ranges} for each in candidates)
        tried[:] = [{"cost": float(cost)} | each for cost, each in zip(found, searched, strict=True)]
        return found

    # Far too few are tried to learn how all these parameters go together: each has a spread of its own.
    for mean in evolve(options, start, ranges, costs, spread=options.spread, digits=4, CMA_diagonal=True):
        lines.append(json.dumps({"generation": len(lines) + 1, "tried": tried, "mean": asdict(mean)}))
        save(trials, "\n".join(lines) + "\n")
        yield mean


def account(options: Options, before: Parameters, after: Parameters, found: Comparison) -> str:
    """What the search found, what it is worth on fresh episodes and what follows from that, as Markdown."""
    ranges = options.subject.ranges
    lines = [
        f"# The parameters of {options.policy}",
        "",
        f"Written by `{options.command}`: CMA-ES, {options.generations} generations of {options.candidates} "
        f"candidates, {options.episodes} episodes of {options.steps * CONTROL_PERIOD:g} s a candidate on each of "
        f"{', '.join(options.exercises)}.",
        WORDS,
        "",
        found.verdict,
        moved(before, after, ranges),
        "",
        *changes(before, after, ranges),
        "",
        *judged("exercise", found.walks),
    ]
    return "\n".join(lines) + "\n"


def main(options: Options) -> int:
    """Search, judge, write; the exit code. Raises UsageError; KeyboardInterrupt, after what was found is kept aside."""
    subject = options.subject
    out = options.out or subject.file
    check(options, out, subject.account)
    check_scenarios("--exercises", options.exercises)
    start, in_force = (subject.read(path) for path in (options.start or subject.file, subject.file))
    aside = out.with_suffix(UNJUDGED)
    trials = out.with_suffix(TRIALS)
    outcome = last(search(options, start, trials), lambda parameters: save(aside, as_json(parameters)))
    seeds = episode_seeds("validation", options.seed, options.check_episodes)
    before, after = options.made((in_force, outcome))
    try:
        found = compared(before, after, options.exercises, seeds, options.threads)
    except KeyboardInterrupt:
        save(aside, as_json(outcome))
        raise KeyboardInterrupt("kept what was found, not judged") from None
    try:
        save(out, as_json(outcome if found.better else in_force))
    finally:
        save(out.with_name(subject.account), account(options, in_force, outcome, found), show=True)
    return 0
