"""Search of parameters by CMA-ES: its effort, its subject, its generations, and the files that it writes.

A generation's candidates are simulated together on the same episodes, other ones in each generation, all from the
"search" family of seeds, which neither training nor evaluation draws. What a search finds is written as JSON, with an
account in Markdown of how it was found and what it changed."""

import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from rich.progress import track

from evaluate.measures.averages import quotient
from evaluate.measures.metrics import Measures
from evaluate.measures.tracking import SETTLING_TIME
from policies.base import CONTROL_PERIOD, Floats
from policies.parameters import Parameters, limits_of, parameter
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.files.writing import write_atomically
from quad_env.seeding import episode_seeds
from train.search.trials import Seeds

Ranges = Mapping[str, tuple[float, float]]
"""Bounds of the parameters that are searched, by field name."""
MARGIN = 0.02
"""Least distance of a start from the faces of the unit cube."""
MIN_EPISODE_STEPS = round(SETTLING_TIME / CONTROL_PERIOD) + 1
"""Shortest episode, control steps: longer than the settling time, which no measure counts."""

TRIALS_SUFFIX = ".trials.jsonl"
"""End of the file of candidates and costs, a line for each generation, with the mean of the distribution after it."""

P = TypeVar("P", bound=Parameters)


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """How thoroughly is searched, and where the outcome goes: options of every search."""

    seed: int = parameter(0, limits=(0, 2**31))
    """Seed of the search."""
    generation_seeds: int = parameter(14, limits=(0, 10_000))
    """Rounds; 0 only does what follows the search."""
    candidates: int = parameter(14, limits=(4, 1000))
    """Parameter sets tried in a round."""
    episodes: int = parameter(10, limits=(1, 10_000))
    """Episodes of a candidate in each scenario and round."""
    steps: int = parameter(750, limits=(MIN_EPISODE_STEPS, 100_000))
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int = parameter(108, limits=(1, 10_000))
    """Fresh episodes on which the outcome is finished and compared with the parameters before."""
    spread: float = parameter(0.15, limits=(1e-6, 0.5))
    """First standard deviation of a parameter, as a share of its range."""
    threads: int = parameter(2, limits=(1, 256))
    """Threads of the simulation."""
    exercises: tuple[str, ...] = ()
    """Scenarios, all of one weight, such as flat push=42+hardware, instead of the usual ones."""
    start: Path | None = None
    """Parameters that the search starts from, JSON, instead of the usual ones."""
    out: Path | None = None
    """File of the outcome, JSON, by default the one that the policy reads; other files of the search are written next
    to it."""

    def command(self, program: str) -> str:
        """The command that repeats the search."""
        words = [program]
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name == "seed" or (value != each.default and each.name not in ("threads", "out")):
                entries = map(str, value if isinstance(value, tuple) else (value,))
                words += [f"--{each.name.replace('_', '-')}", *entries]
        return " ".join(words)


E = TypeVar("E", bound=SearchOptions)


@dataclass(frozen=True)
class SearchProblem(Generic[P]):
    """What is searched: parameters, each of which goes from 0 to 1 over its range, in the unit cube."""

    start: P
    ranges: Ranges
    costs: Callable[[list[P], Seeds], Sequence[float] | Floats]
    """Costs of a generation's candidates on the same episodes."""
    finalize: Callable[[P], tuple[str, str]]
    """Of the mean of the last generation the text of the file, and the account of how it was found, Markdown."""
    file: Path
    """Where the outcome goes."""
    account: str
    """File of the account, next to the outcome."""
    digits: int | None = None
    """To which candidates are rounded."""
    diagonal: bool = False
    """Whether each parameter has a spread of its own, for spaces with too many to learn how they go together."""


def decode(point: Floats, start: P, ranges: Ranges, digits: int | None = None) -> P:
    """Parameters of a point of the unit cube, rounded where digits are given; those not searched are the start's."""
    values = {name: low + (high - low) * float(x) for x, (name, (low, high)) in zip(point, ranges.items(), strict=True)}
    return replace(start, **(values if digits is None else {name: round(x, digits) for name, x in values.items()}))


def encode(parameters: Parameters, ranges: Ranges) -> Floats:
    """Point of the unit cube of some parameters."""
    return np.array([(getattr(parameters, name) - low) / (high - low) for name, (low, high) in ranges.items()])


def round_parameters(parameters: P) -> P:
    """The parameters to four digits."""
    return replace(parameters, **{name: round(float(value), 4) for name, value in vars(parameters).items()})


def generations(effort: SearchOptions) -> list[Seeds]:
    """Seeds of the episodes of each generation, new ones in each."""
    seeds = episode_seeds("search", effort.seed, effort.generation_seeds * effort.episodes)
    return [seeds[place : place + effort.episodes] for place in range(0, len(seeds), effort.episodes)]


def search(subject_of: Callable[[E], SearchProblem[Any]], options: E) -> int:
    """Search, conclude, write; the exit code. Raises UsageError, also for numbers beyond their limits."""
    check_numbers(options, limits_of(options))
    subject = subject_of(options)
    out = options.out or subject.file
    if out.name == subject.account:
        raise UsageError(f"--out must not be {subject.account}, which the account goes to")
    make_folder_of(out, "--out")
    raise_on_interrupt()
    found, lines, trials = subject.start, list[str](), out.with_suffix(TRIALS_SUFFIX)
    try:
        for found, tried in evolve(options, subject):
            lines.append(json.dumps({"generation": len(lines) + 1, "tried": tried, "mean": vars(found)}))
            save(trials, "\n".join(lines) + "\n")
        outcome, account = subject.finalize(found)
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


def evolve(effort: SearchOptions, subject: SearchProblem[P]) -> Iterator[tuple[P, list[dict[str, Any]]]]:
    """After each generation the mean of CMA-ES's distribution, and the candidates with their costs."""
    import cma

    settings = {"popsize": effort.candidates, "seed": effort.seed + 1, "verbose": -9, "bounds": [0, 1]}
    settings |= {"CMA_diagonal": True} if subject.diagonal else {}
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


def parameters_to_json(parameters: Any) -> str:
    """The parameters as the text of a file."""
    return json.dumps(asdict(parameters), indent=2) + "\n"


def save(path: Path, text: str, *, show: bool = False) -> None:
    """Write the text, and print it where asked for or where it would be lost. Raises UsageError where it cannot be."""
    problem = ""
    try:
        write_atomically(path, text.encode())
    except OSError as error:
        problem = f"cannot write {path} ({error.strerror or error}): its contents are on standard output"
    if show or problem:
        print(text, flush=True)
    if problem:
        raise UsageError(problem)


def describe_method(program: str, effort: SearchOptions, scenarios: str) -> str:
    """How the search was made, for its account."""
    return (
        f"Written by `{effort.command(program)}`: CMA-ES, {effort.generation_seeds} generations of {effort.candidates} "
        f"candidates, {effort.episodes} episodes of {effort.steps * CONTROL_PERIOD:g} s a candidate on each of "
        f"{scenarios}."
    )


def parameter_table(before: Parameters, after: Parameters, ranges: Ranges, fitted: Collection[str] = ()) -> list[str]:
    """Range and values of every parameter, as a table."""
    lines = ["| parameter | range | before | after |", "|---|---|---|---|"]
    for name, old in asdict(before).items():
        otherwise = "fitted" if name in fitted else "fixed"
        span = "{:g} … {:g}".format(*ranges[name]) if name in ranges else otherwise
        lines.append(f"| {name} | {span} | {old:.9g} | {getattr(after, name):.9g} |")
    return lines


COLUMNS = {
    "velocity_error": "velocity error, m/s",
    "yaw_rate_error": "yaw-rate error, rad/s",
    "cost_of_transport": "cost of transport",
    "step_rate": "steps a second",
    "duty_factor": "duty factor",
    "flight": "flight",
    "trunk_height": "trunk height",
}
"""Measures of which an account has the means."""


def results_table(rows: Iterable[tuple[str, str, Measures]]) -> list[str]:
    """Measures on each scenario with the parameters before and after, (scenario, which, measures) each, as a table."""
    head = ["scenario", "parameters", "succeeded", "stalled", "falls", *COLUMNS.values()]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for name, label, found in rows:
        counts = [f"{int(each.sum())}/{len(each)}" for each in (found.succeeded, found.stalled, found.fell)]
        values = [getattr(found, each) for each in COLUMNS]
        means = [quotient(np.nansum(each), np.isfinite(each).sum()) for each in values]
        lines.append(f"| {' | '.join([name, label, *counts, *(f'{float(mean):.3f}' for mean in means)])} |")
    return lines
