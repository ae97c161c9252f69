"""Search of policy parameters by CMA-ES: options, problem, generations, and output files.

A candidate is a set of parameters. All candidates of a generation are simulated together on the same episodes. Every
generation has new episodes. Their seeds belong to the purpose "search", so that no training or evaluation uses them.
The result is written as JSON. A report in Markdown describes the search and the change of the parameters.
"""

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
"""Name of the searched parameter -> lower and upper bound."""
MARGIN = 0.02
"""Smallest distance between the start of the search and the faces of the unit cube."""
MIN_EPISODE_STEPS = round(SETTLING_TIME / CONTROL_PERIOD) + 1
"""Shortest episode: one step longer than the settling time, which the measures ignore, control steps."""

TRIALS_SUFFIX = ".trials.jsonl"
"""Suffix of the file of trials. Each line has the candidates of a generation, their costs, and the new mean of CMA-ES.
"""

P = TypeVar("P", bound=Parameters)


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Options of every search: its budget, its scenarios and its files."""

    seed: int = parameter(0, limits=(0, 2**31))
    """Seed of the search."""
    generations: int = parameter(14, limits=(0, 10_000))
    """Rounds; 0 skips the search and does the rest."""
    candidates: int = parameter(14, limits=(4, 1000))
    """Parameter sets tried in a round."""
    episodes: int = parameter(10, limits=(1, 10_000))
    """Episodes of a candidate in each scenario and round."""
    steps: int = parameter(750, limits=(MIN_EPISODE_STEPS, 100_000))
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int = parameter(108, limits=(1, 10_000))
    """Fresh episodes on which the outcome is finished and compared with the old parameters."""
    spread: float = parameter(0.15, limits=(1e-6, 0.5))
    """Initial standard deviation of a parameter, as a share of its range."""
    threads: int = parameter(2, limits=(1, 256))
    """Threads of the simulation."""
    exercises: tuple[str, ...] = ()
    """Scenarios with equal weights instead of the usual ones, for example flat push=42+hardware."""
    start: Path | None = None
    """Parameters that the search starts from, JSON, instead of the usual ones."""
    out: Path | None = None
    """File of the outcome, JSON, by default the one that the policy reads; other files of the search are written next
    to it."""

    def command(self, program: str) -> str:
        """Return the command line of `program` that repeats the search."""
        words = [program]
        for option in fields(self):
            value = getattr(self, option.name)
            if option.name == "seed" or (value != option.default and option.name not in ("threads", "out")):
                entries = map(str, value if isinstance(value, tuple) else (value,))
                words += [f"--{option.name.replace('_', '-')}", *entries]
        return " ".join(words)


E = TypeVar("E", bound=SearchOptions)


@dataclass(frozen=True)
class SearchProblem(Generic[P]):
    """Definition of a search: start, ranges of the parameters, cost function and output files.

    Each parameter is scaled to 0 … 1 over its range, so that CMA-ES searches the unit cube.
    """

    start: P
    """Parameters at the start of the search."""
    ranges: Ranges
    """Bounds of the searched parameters."""
    costs: Callable[[list[P], Seeds], Sequence[float] | Floats]
    """Function that returns the cost of each candidate on the episodes with the given seeds."""
    finalize: Callable[[P], tuple[str, str]]
    """Function that converts the mean of the last generation to the text of the parameter file and of the report."""
    file: Path
    """Default path of the parameter file that the search writes."""
    account: str
    """Name of the report file, which is written next to the parameter file."""
    digits: int | None = None
    """Number of decimals to which the parameters of candidates are rounded; None for no rounding."""
    diagonal: bool = False
    """True: CMA-ES uses a diagonal covariance, because the candidates are too few to learn a full one."""


def decode(point: Floats, start: P, ranges: Ranges, digits: int | None = None) -> P:
    """Convert a point of the unit cube to parameters.

    Args:
        point: Point of the unit cube, with one coordinate for each entry of `ranges`.
        start: Parameters with the values of the fields that are not searched.
        ranges: Bounds of the searched parameters.
        digits: Number of decimals to which searched parameters are rounded; None for no rounding.

    Returns:
        The parameters.
    """
    values = {name: low + (high - low) * float(x) for x, (name, (low, high)) in zip(point, ranges.items(), strict=True)}
    return replace(start, **(values if digits is None else {name: round(x, digits) for name, x in values.items()}))


def encode(parameters: Parameters, ranges: Ranges) -> Floats:
    """Convert `parameters` to a point of the unit cube.

    `ranges` has the bounds of the searched parameters.

    Args:
        parameters: Parameters of the policy.
        ranges: Bounds of the searched parameters, by name.

    Returns:
        The point.
    """
    return np.array([(getattr(parameters, name) - low) / (high - low) for name, (low, high) in ranges.items()])


def round_parameters(parameters: P) -> P:
    """Round every parameter to four decimals."""
    return replace(parameters, **{name: round(float(value), 4) for name, value in vars(parameters).items()})


def generation_seeds(options: SearchOptions) -> list[Seeds]:
    """Return the seeds of the episodes of each generation. No two generations have a seed in common."""
    seeds = episode_seeds("search", options.seed, options.generations * options.episodes)
    return [seeds[first : first + options.episodes] for first in range(0, len(seeds), options.episodes)]


def search(make_problem: Callable[[E], SearchProblem[Any]], options: E) -> int:
    """Run a search and write its files.

    Args:
        make_problem: Function that makes the search problem from the options.
        options: Options of the search. UsageError is raised for numbers outside their limits.

    Returns:
        The exit code, 0.

    Raises:
        UsageError: The options are not valid, or a file cannot be read or written.
        KeyboardInterrupt: After Ctrl-C. The message names the file of trials, if a generation is complete.
    """
    check_numbers(options, limits_of(options))
    problem = make_problem(options)
    out = options.out or problem.file
    if out.name == problem.account:
        raise UsageError(f"--out must not be {problem.account}, which the account goes to")
    make_folder_of(out, "--out")
    raise_on_interrupt()
    mean = problem.start
    lines = list[str]()
    trials = out.with_suffix(TRIALS_SUFFIX)
    try:
        for mean, tried in evolve(options, problem):
            lines.append(json.dumps({"generation": len(lines) + 1, "tried": tried, "mean": vars(mean)}))
            save(trials, "\n".join(lines) + "\n")
        outcome, account = problem.finalize(mean)
    except KeyboardInterrupt:
        if not lines:
            raise
        raise KeyboardInterrupt(f"{trials} has what was found in {len(lines)} generations, not compared") from None
    try:
        save(out, outcome)
    finally:
        save(out.with_name(problem.account), account, show=True)
    print(out)
    return 0


def evolve(options: SearchOptions, problem: SearchProblem[P]) -> Iterator[tuple[P, list[dict[str, Any]]]]:
    """Run the generations of CMA-ES.

    Args:
        options: Number and size of the generations, initial spread, and seed.
        problem: Search problem.

    Yields:
        After each generation, the mean of the distribution as parameters, and its candidates with their costs.
    """
    import cma

    settings = {"popsize": options.candidates, "seed": options.seed + 1, "verbose": -9, "bounds": [0, 1]}
    settings |= {"CMA_diagonal": True} if problem.diagonal else {}
    first = np.clip(encode(problem.start, problem.ranges), MARGIN, 1.0 - MARGIN)
    strategy = cma.CMAEvolutionStrategy(first, options.spread, settings)
    for seeds in track(generation_seeds(options), description="generations"):
        points = strategy.ask()
        candidates = [decode(point, problem.start, problem.ranges, problem.digits) for point in points]
        costs = problem.costs(candidates, seeds)
        strategy.tell(points, list(costs))
        print(f"best {min(costs):.3f}  median {np.median(costs):.3f}", flush=True)
        tried = [{"cost": float(cost)} | asdict(candidate) for cost, candidate in zip(costs, candidates, strict=True)]
        mean = np.clip(strategy.result.xfavorite, 0, 1)
        yield decode(mean, problem.start, problem.ranges, problem.digits), tried


def parameters_to_json(parameters: Any) -> str:
    """Return the text of a JSON file with the parameters."""
    return json.dumps(asdict(parameters), indent=2) + "\n"


def save(path: Path, text: str, *, show: bool = False) -> None:
    """Write a text file.

    Args:
        path: File to write.
        text: Contents of the file. They are printed if the file cannot be written.
        show: True: print the contents in any case.

    Raises:
        UsageError: The file cannot be written.
    """
    problem = ""
    try:
        write_atomically(path, text.encode())
    except OSError as error:
        problem = f"cannot write {path} ({error.strerror or error}): its contents are on standard output"
    if show or problem:
        print(text, flush=True)
    if problem:
        raise UsageError(problem)


def describe_method(program: str, options: SearchOptions, scenarios: str) -> str:
    """Describe the method and the budget of a search, for its report.

    Args:
        program: Command of the search, for example `python -m train search trot`.
        options: Options of the search.
        scenarios: Names of the scenarios of the search, separated by commas.

    Returns:
        A sentence.
    """
    return (
        f"Written by `{options.command(program)}`: CMA-ES, {options.generations} generations of {options.candidates} "
        f"candidates, {options.episodes} episodes of {options.steps * CONTROL_PERIOD:g} s a candidate on each of "
        f"{scenarios}."
    )


def parameter_table(before: Parameters, after: Parameters, ranges: Ranges, fitted: Collection[str] = ()) -> list[str]:
    """Tabulate the parameters before and after a search.

    Args:
        before: Parameters before the search.
        after: Parameters after the search.
        ranges: Bounds of the searched parameters.
        fitted: Names of the parameters that were fitted after the search.

    Returns:
        Lines of a Markdown table.
    """
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
"""Name of the measure -> heading of its column in a report. The column has the mean over the episodes."""


def results_table(rows: Iterable[tuple[str, str, Measures]]) -> list[str]:
    """Tabulate the results before and after a search.

    Args:
        rows: Rows of the table: the scenario, the word `before` or `after`, and the measures of the episodes.

    Returns:
        Lines of a Markdown table.
    """
    head = ["scenario", "parameters", "succeeded", "stalled", "falls", *COLUMNS.values()]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for name, label, measures in rows:
        outcomes = (measures.succeeded, measures.stalled, measures.fell)
        counts = [f"{int(outcome.sum())}/{len(outcome)}" for outcome in outcomes]
        values = [getattr(measures, column) for column in COLUMNS]
        means = [float(quotient(np.nansum(column), np.isfinite(column).sum())) for column in values]
        lines.append(f"| {' | '.join([name, label, *counts, *(f'{mean:.3f}' for mean in means)])} |")
    return lines
