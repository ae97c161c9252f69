"""Search of parameters by CMA-ES: a generation's candidates are simulated together on the same episodes, other ones in
each generation, all from the "search" family of seeds, which neither training nor evaluation draws.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np
from rich.progress import track

from policies.parameters import Parameters, limits_of
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of
from quad_env.cli.launcher import raise_on_interrupt
from train.search.files import save
from train.search.subject import MARGIN, Effort, Subject, decode, encode, generations

TRIALS = ".trials.jsonl"
"""End of the file of candidates and costs, a line for each generation, with the mean of the distribution after it."""

P = TypeVar("P", bound=Parameters)
E = TypeVar("E", bound=Effort)


def search(subject_of: Callable[[E], Subject[Any]], options: E) -> int:
    """Search, conclude, write; the exit code. Raises UsageError, also for numbers beyond their limits."""
    check_numbers(options, limits_of(options))
    subject = subject_of(options)
    out = options.out or subject.file
    if out.name == subject.account:
        raise UsageError(f"--out must not be {subject.account}, which the account goes to")
    make_folder_of(out, "--out")
    raise_on_interrupt()
    found, lines, trials = subject.start, list[str](), out.with_suffix(TRIALS)
    try:
        for found, tried in evolve(options, subject):
            lines.append(json.dumps({"generation": len(lines) + 1, "tried": tried, "mean": vars(found)}))
            save(trials, "\n".join(lines) + "\n")
        outcome, account = subject.conclude(found)
    except KeyboardInterrupt:
        if not lines:
            raise
        raise KeyboardInterrupt(f"{trials} has what was found in {len(lines)} generations, not compared") from None
    try:
        save(out, outcome)
    finally:
        save(out.with_name(subject.account), account, show=True)
    print(out)
    return 0


def evolve(effort: Effort, subject: Subject[P]) -> Iterator[tuple[P, list[dict[str, Any]]]]:
    """After each generation the mean of CMA-ES's distribution, and the candidates with their costs."""
    import cma

    settings = {"popsize": effort.candidates, "seed": effort.seed + 1, "verbose": -9, "bounds": [0, 1]}
    settings |= {"CMA_diagonal": True} if subject.apart else {}
    start, ranges, digits = subject.start, subject.ranges, subject.digits
    first = np.clip(encode(start, ranges), MARGIN, 1.0 - MARGIN)
    strategy = cma.CMAEvolutionStrategy(first, effort.spread, settings)
    for seeds in track(generations(effort), description="generations"):
        points = strategy.ask()
        candidates = [decode(point, start, ranges, digits) for point in points]
        costs = subject.costs(candidates, seeds)
        strategy.tell(points, list(costs))
        print(f"best {min(costs):.3f}  median {np.median(costs):.3f}", flush=True)
        tried = [{"cost": float(cost)} | asdict(each) for cost, each in zip(costs, candidates, strict=True)]
        yield decode(np.clip(strategy.result.xfavorite, 0, 1), start, ranges, digits), tried
