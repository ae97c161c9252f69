"""Search of policy parameters by CMA-ES: options, problem, generations, and output files.

A candidate is a set of parameters. All candidates of a generation are simulated together on the same episodes. Every
generation has new episodes. No training or evaluation uses the seeds of these episodes.
The result is written as JSON. A report in Markdown describes the search and the change of the parameters.
"""

import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from rich.progress import track

from evaluate.measures.averages import quotient
from evaluate.measures.metrics import Measures
from evaluate.measures.tracking import SETTLING_TIME
from evaluate.records.software import software_versions
from evaluate.rollouts.cluster import Report, VersionCheck, connect
from evaluate.rollouts.task_files import Unpacked, mark_files
from policies.base import CONTROL_PERIOD, Floats
from policies.parameters import Parameters, limits_of, parameter
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.cli.ray_option import RayOption, parse_ray
from quad_env.files.writing import write_atomically
from quad_env.seeding import episode_seeds
from train.search.trials import Seeds

Ranges = Mapping[str, tuple[float, float]]
"""Type of the search ranges: name of a searched parameter -> (lower bound, upper bound), in its unit."""
MARGIN = 0.02
"""Smallest distance between the start point of CMA-ES and the faces of the unit cube, dimensionless.

Each coordinate of the unit cube is a searched parameter, scaled to 0 … 1 over its range."""
MIN_EPISODE_STEPS = round(SETTLING_TIME / CONTROL_PERIOD) + 1
"""Length of the shortest episode of a search, control steps.

The episode is one step longer than the settling time after a new command, because the metrics ignore that time."""

TRIALS_SUFFIX = ".trials.jsonl"
"""Suffix of the file in which a search records its generations.

Each line is the JSON of a generation: the candidate parameters, their costs, and the new mean of the CMA-ES
distribution."""

P = TypeVar("P", bound=Parameters)
Costs = Callable[[list[P], Seeds], Sequence[float] | Floats]
"""Cost function: takes k candidates and the seeds of the episodes, and returns k mean costs; smaller is better."""


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Command-line options of every parameter search: budget, scenarios and files."""

    seed: int = parameter(0, limits=(0, 2**31))
    """Seed of the random numbers of CMA-ES, and of the episodes of the search."""
    generations: int = parameter(14, limits=(0, 10_000))
    """Number of generations of CMA-ES; with 0 the start parameters are only completed, compared and written."""
    candidates: int = parameter(14, limits=(4, 1000))
    """Number of parameter sets (candidates) per generation."""
    episodes: int = parameter(10, limits=(1, 10_000))
    """Number of episodes per candidate, scenario and generation."""
    steps: int = parameter(750, limits=(MIN_EPISODE_STEPS, 100_000))
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int = parameter(108, limits=(1, 10_000))
    """Number of new episodes per scenario, for the completion of the result and for its comparison with the old
    parameters."""
    spread: float = parameter(0.15, limits=(1e-6, 0.5))
    """Initial standard deviation of each parameter, as a fraction of its range."""
    threads: int = parameter(2, limits=(1, 256))
    """Number of threads of the simulation."""
    exercises: tuple[str, ...] = ()
    """Scenarios with equal weights that replace the default ones of the search, for example flat push=42+hardware."""
    ray: RayOption = None
    """Compute the costs of the candidates on a Ray cluster (pip install -e ".[cluster]"): at HOST:PORT, or without a
    value on one of --threads workers that is started on this machine. No result depends on it."""
    start: Path | None = None
    """JSON file with the start parameters of the search; by default the search has its own start parameters."""
    out: Path | None = None
    """JSON file for the resulting parameters; by default the file that the policy reads. The other files of the search
    are written to the same folder."""

    def command(self, program: str) -> str:
        """Return the command line that repeats the search.

        `program` is the command without options, for example `python -m train search trot`.
        """
        words = [program]
        for option in fields(self):
            value = getattr(self, option.name)
            if option.name == "seed" or (value != option.default and option.name not in ("threads", "ray", "out")):
                entries = map(str, value if isinstance(value, tuple) else (value,))
                words += [f"--{option.name.replace('_', '-')}", *entries]
        return " ".join(words)


E = TypeVar("E", bound=SearchOptions)


@dataclass(frozen=True)
class SearchProblem(Generic[P]):
    """Definition of a parameter search: start, ranges of the parameters, cost function and output files.

    Each searched parameter is scaled to 0 … 1 over its range, so that CMA-ES searches the unit cube.
    """

    start: P
    """Parameters at the start of the search."""
    ranges: Ranges
    """Name of each searched parameter -> (lower bound, upper bound), in its unit."""
    costs: Costs[P]
    """Cost function: takes k candidates and the seeds of the episodes, and returns k mean costs; smaller is better."""
    finalize: Callable[[P], tuple[str, str]]
    """Function that completes the result of the search and describes it.

    The function takes the mean of the last generation of CMA-ES, as parameters, and can fit further parameters. The
    function returns two texts: the contents of the parameter file (JSON) and of the report (Markdown)."""
    file: Path
    """Path of the parameter file that the search writes if --out is not given."""
    account: str
    """Name of the report file, which the search writes to the folder of the parameter file."""
    digits: int | None = None
    """Number of decimals to which the searched parameters of candidates are rounded; None for no rounding."""
    diagonal: bool = False
    """True if CMA-ES has a diagonal covariance matrix, because there are too few candidates to learn a full one."""


def decode(point: Floats, start: P, ranges: Ranges, digits: int | None = None) -> P:
    """Convert a point of the unit cube, in which CMA-ES searches, to the parameters of a policy.

    Args:
        point: Point of the unit cube, (k,), with one coordinate for each of the k parameters in `ranges`.
        start: Parameters from which the fields that are not searched are copied.
        ranges: Name of each searched parameter -> (lower bound, upper bound).
        digits: Number of decimals to which searched parameters are rounded; None for no rounding.

    Returns:
        The parameters of the policy.
    """
    values = {name: low + (high - low) * float(x) for x, (name, (low, high)) in zip(point, ranges.items(), strict=True)}
    return replace(start, **(values if digits is None else {name: round(x, digits) for name, x in values.items()}))


def encode(parameters: Parameters, ranges: Ranges) -> Floats:
    """Convert the parameters of a policy to a point of the unit cube, in which CMA-ES searches.

    Args:
        parameters: Parameters of the policy.
        ranges: Name of each of the k searched parameters -> (lower bound, upper bound).

    Returns:
        Point of the unit cube, (k,).
    """
    return np.array([(getattr(parameters, name) - low) / (high - low) for name, (low, high) in ranges.items()])


def round_parameters(parameters: P) -> P:
    """Return a copy of the parameters of a policy in which each number is rounded to four decimals."""
    return replace(parameters, **{name: round(float(value), 4) for name, value in vars(parameters).items()})


def generation_seeds(options: SearchOptions) -> list[Seeds]:
    """Return the episode seeds of each generation of a search. Every generation has different seeds."""
    seeds = episode_seeds("search", options.seed, options.generations * options.episodes)
    return [seeds[first : first + options.episodes] for first in range(0, len(seeds), options.episodes)]


def search(make_problem: Callable[[E], SearchProblem[Any]], options: E) -> int:
    """Run a parameter search, and write the parameter file, the report and the record of the generations.

    Args:
        make_problem: Function that makes the search problem from the options.
        options: Options of the search. UsageError is raised for numbers outside their limits.

    Returns:
        The exit code, 0.

    Raises:
        UsageError: The options are not valid, a file cannot be read or written, or the Ray cluster fails.
        KeyboardInterrupt: After Ctrl-C. The message names the file with the completed generations, if there are any.
    """
    check_numbers(options, limits_of(options))
    if options.ray is not None:
        parse_ray(options.ray)
    problem = make_problem(options)
    if options.ray is not None:
        # Each candidate runs on one core of the cluster.
        problem = replace(problem, costs=make_problem(mark_files(replace(options, threads=1))).costs)
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
    """Run CMA-ES (covariance matrix adaptation evolution strategy), one generation per iteration.

    Args:
        options: Options of the search: number and size of the generations, initial standard deviation, and seed.
        problem: Definition of the search.

    Yields:
        Two items after each generation: the mean of the distribution, as parameters; and a list with a dictionary for
        each candidate, with the key "cost" and the names of its parameters.
    """
    import cma

    settings = {"popsize": options.candidates, "seed": options.seed + 1, "verbose": -9, "bounds": [0, 1]}
    settings |= {"CMA_diagonal": True} if problem.diagonal else {}
    first = np.clip(encode(problem.start, problem.ranges), MARGIN, 1.0 - MARGIN)
    strategy = cma.CMAEvolutionStrategy(first, options.spread, settings)
    with _cost_function(options, problem) as compute_costs:
        for seeds in track(generation_seeds(options), description="generations"):
            points = strategy.ask()
            candidates = [decode(point, problem.start, problem.ranges, problem.digits) for point in points]
            costs = compute_costs(candidates, seeds)
            strategy.tell(points, list(costs))
            print(f"best {min(costs):.3f}  median {np.median(costs):.3f}", flush=True)
            paired = zip(costs, candidates, strict=True)
            tried = [{"cost": float(cost)} | asdict(candidate) for cost, candidate in paired]
            mean = np.clip(strategy.result.xfavorite, 0, 1)
            yield decode(mean, problem.start, problem.ranges, problem.digits), tried


@contextmanager
def _cost_function(options: SearchOptions, problem: SearchProblem[P]) -> Iterator[Costs[P]]:
    """Provide the cost function of a search, which runs on a Ray cluster if the options select one.

    On a cluster, each candidate is a task. A candidate has the same cost alone as with others in one batch.

    Args:
        options: Options of the search.
        problem: Definition of the search.

    Yields:
        The cost function.
    """
    if options.ray is None:
        yield problem.costs
        return
    check_versions = VersionCheck(_versions(), _versions)
    with connect(parse_ray(options.ray), options.threads, check_versions) as cluster:

        def costs(candidates: list[P], seeds: Seeds) -> list[float]:
            """Return the mean cost of each candidate."""
            values = [partial(_with_costs, problem.costs, candidate, seeds) for candidate in candidates]
            results = dict(cluster.run(_compute_cost, values, lambda *_: None))
            return [results[index] for index in range(len(candidates))]

        yield costs


def _versions() -> dict[str, str]:
    """Return the versions of the software on which the costs of candidates depend."""
    return software_versions(sources=("train",))


def _with_costs(costs: Costs[P], candidate: P, seeds: Seeds) -> tuple[Costs[P], P, Seeds]:
    """Return the value of a task that computes the cost of one candidate."""
    return costs, candidate, seeds


def _compute_cost(unpacked: Unpacked, report: Report) -> float:
    """Compute the cost of one candidate in a worker of a cluster.

    Args:
        unpacked: Cost function, candidate, and seeds of the episodes.
        report: Function for messages about the progress, which is not called.

    Returns:
        The mean cost.
    """
    costs, candidate, seeds = unpacked.value
    return float(costs([candidate], seeds)[0])


def parameters_to_json(parameters: Any) -> str:
    """Return the parameters of a policy, which are a dataclass, as the text of a JSON file."""
    return json.dumps(asdict(parameters), indent=2) + "\n"


def save(path: Path, text: str, *, show: bool = False) -> None:
    """Write a text file of a search, and print the text if the file cannot be written.

    Args:
        path: File to write.
        text: Contents of the file.
        show: True: print the contents also if the file can be written.

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
    """Describe the method and the budget of a parameter search in a sentence for its report.

    Args:
        program: Command of the search, for example `python -m train search trot`.
        options: Options of the search.
        scenarios: Names of the scenarios of the search, separated by commas.

    Returns:
        The sentence.
    """
    return (
        f"Written by `{options.command(program)}`: CMA-ES, {options.generations} generations of {options.candidates} "
        f"candidates, {options.episodes} episodes of {options.steps * CONTROL_PERIOD:g} s a candidate on each of "
        f"{scenarios}."
    )


def parameter_table(before: Parameters, after: Parameters, ranges: Ranges, fitted: Collection[str] = ()) -> list[str]:
    """Make a Markdown table of the parameters of a policy before and after a search.

    Args:
        before: Parameters before the search.
        after: Parameters after the search.
        ranges: Name of each searched parameter -> (lower bound, upper bound).
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
"""Metric of an episode -> heading of its column in the report of a search.

The column has the mean of the metric over the episodes."""


def results_table(rows: Iterable[tuple[str, str, Measures]]) -> list[str]:
    """Make a Markdown table of the evaluation results of a policy before and after a search.

    Args:
        rows: A tuple for each row of the table: the scenario name, the word `before` or `after`, and the metrics of the
            episodes.

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
