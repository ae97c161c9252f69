"""Search of parameters by CMA-ES: `python -m train search SUBJECT` writes the file that the policy reads.

A generation's candidates are simulated together on the same episodes. Every generation has new ones, all from the
"search" family of seeds, which neither training nor evaluation draws. Candidates and their costs are in a file that
ends in .trials.jsonl, a line for each generation; after Ctrl-C the mean found so far is in one that ends in
.unjudged.json. `search feedback` takes 26 minutes on one core, three times as long for mpc_wbc.

Defaults:

    subject   generations  candidates  episodes  steps  check-episodes  spread
    trot               14          14        10    600             108    0.15
    feedback           22          16         1    500              32    0.15
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from rich.progress import track

from policies.parameters import limits_of
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.launcher import raise_on_interrupt
from train.search import feedback, trot
from train.search.files import as_json, check, save
from train.search.subject import SHORTEST, Effort, Options, Space, Subject

UNJUDGED = ".unjudged.json"
"""Ending of the file that keeps parameters which have not been compared with those in force."""
TRIALS = ".trials.jsonl"
"""Ending of the file of all trials: a line a generation, with the mean of the distribution after it."""


T = TypeVar("T")


@dataclass(frozen=True)
class Kind:
    """A row of the table of subjects."""

    make: Callable[[Options, Effort], Subject[Any]]
    usual: Effort
    least: Effort
    """Smallest numbers with which it makes sense."""
    options: tuple[str, ...]
    """Options that this subject has alone."""


MOST = Effort(10_000, 1000, 10_000, 100_000, 10_000, 0.5)
SUBJECTS: Mapping[str, Kind] = {
    "trot": Kind(
        trot.subject,
        Effort(14, 14, 10, 600, 108, 0.15),
        # Two command intervals an episode, enough to fit a response.
        Effort(0, 4, trot.MINIMUM_INTERVALS, SHORTEST, trot.MINIMUM_INTERVALS // 2, 1e-6),
        ("robot",),
    ),
    "feedback": Kind(
        feedback.subject,
        Effort(22, 16, 1, 500, 32, 0.15),
        Effort(0, 4, 1, SHORTEST, 1, 1e-6),
        ("policy", "exercises", "start"),
    ),
}


def main(options: Options) -> int:
    """Search, conclude, write; the exit code. Raises UsageError; KeyboardInterrupt, after the mean of the last
    generation is kept."""
    effort = effort_of(options)
    subject = SUBJECTS[options.subject].make(options, effort)
    out = options.out or subject.file
    check(out, subject.account)
    raise_on_interrupt()
    found, lines = subject.start, list[str]()
    try:
        for found, tried in evolve(options.seed, effort, subject.space):
            lines.append(json.dumps({"generation": len(lines) + 1, "tried": tried, "mean": vars(found)}))
            save(out.with_suffix(TRIALS), "\n".join(lines) + "\n")
        outcome = subject.conclude(found)
    except KeyboardInterrupt:
        if not lines:
            raise
        save(out.with_suffix(UNJUDGED), as_json(found))
        raise KeyboardInterrupt(f"kept what was found after {len(lines)} generations, not compared") from None
    try:
        save(out, outcome.text)
    finally:
        save(out.with_name(subject.account), outcome.account, show=True)
    print(out)
    return 0


def effort_of(options: Options) -> Effort:
    """The subject's effort with the numbers that are given. Raises UsageError for an option that the subject has not,
    and for a number beyond its limits."""
    kind = SUBJECTS[options.subject]
    for name in {name for each in SUBJECTS.values() for name in each.options} - set(kind.options):
        if getattr(options, name) not in (None, ()):
            raise UsageError(f"search {options.subject} has no --{name}")
    numbers = [each.name for each in fields(Effort)]
    given = {name: getattr(options, name) for name in numbers if getattr(options, name) is not None}
    effort = replace(kind.usual, **given)
    check_numbers(options, limits_of(options))
    check_numbers(effort, {name: (getattr(kind.least, name), getattr(MOST, name)) for name in numbers})
    return effort


def evolve(seed: int, effort: Effort, space: Space[T]) -> Iterator[tuple[T, list[dict[str, Any]]]]:
    """After each generation the mean of CMA-ES's distribution, and the candidates with their costs."""
    import cma

    settings: dict[str, Any] = {"popsize": effort.candidates, "seed": seed + 1, "verbose": -9}
    settings |= {"bounds": [0, 1]} | ({"CMA_diagonal": True} if space.apart else {})
    strategy = cma.CMAEvolutionStrategy(space.start, effort.spread, settings)
    for seeds in track(space.seeds, description="generations"):
        points = strategy.ask()
        candidates: list[Any] = [space.decode(point) for point in points]
        costs = space.costs(candidates, seeds)
        strategy.tell(points, list(costs))
        print(f"best {min(costs):.3f}  median {np.median(costs):.3f}", flush=True)
        tried = [{"cost": float(cost)} | asdict(each) for cost, each in zip(costs, candidates, strict=True)]
        yield space.decode(np.clip(strategy.result.xfavorite, 0, 1)), tried
