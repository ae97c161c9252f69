"""Leaderboard of a robot: `python -m research leaderboard LIST` evaluates the policies of a list.

LIST is a TOML file with the robot and the policies. Each policy has a separate evaluation, as by `python -m evaluate`;
a finished evaluation is not repeated. The command writes a page and CSV files with the results of all policies.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from evaluate.analysis.results import Results, analyse, nan_to_null
from evaluate.commands import options as evaluation
from evaluate.commands.execution import execute
from evaluate.commands.options import Flag
from evaluate.commands.plan import Plan, check
from evaluate.records import manifest
from evaluate.records.store import Run, read_run
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.files.writing import write_atomically
from research.pages import leaderboard_page, policy_list
from research.pages.csv_text import flatten_entry, to_csv
from research.pages.policy_list import PolicyList

SCENARIOS = "flat", "push", "rough", "noise:3", "latency:3"
"""Names of the scenarios on which a leaderboard compares the policies by default."""


@dataclass(frozen=True)
class LeaderboardOptions:
    """Options of the command `leaderboard`: policies to compare, and files of their results."""

    list: Annotated[Path, tyro.conf.Positional]
    """TOML file with the list of policies, for example docs/leaderboard/go1.toml."""
    files: Path = Path("results/policies")
    """Folder with the files of published policies: clones of their repositories, or downloads by --fetch."""
    fetch: Flag = False
    """Download the files of published policies that are missing."""
    trust: Flag = False
    """Load policies from files that can contain hidden code."""
    reference: str | None = None
    """Policy with which all policies are compared; by default this project's policy with the highest mean success."""
    scenarios: tuple[str, ...] = SCENARIOS
    """Names of the scenarios, as for `python -m evaluate`."""
    episodes: int = 24
    """Number of episodes of each policy on each scenario."""
    threads: int = available_cores()
    """Number of processes that simulate; the results do not depend on it."""
    runs: Path = Path("results/leaderboard")
    """Folder in which the evaluation of each policy is stored."""
    out: Path | None = None
    """Markdown page to write; CSV files go to results/ next to it; default: docs/leaderboard_NAME.md for NAME.toml."""


def main(options: LeaderboardOptions) -> int:
    """Run the command `leaderboard`: evaluate the policies, and write the page and CSV files.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An option or a policy is invalid, or a file is missing.
    """
    policies = policy_list.read_list(options.list)
    if options.reference not in (None, *policies.names):
        raise UsageError(f"--reference: {options.reference} is not in the list: {', '.join(policies.names)}")
    out = options.out or Path("docs") / f"leaderboard_{options.list.stem}.md"
    data = out.parent / "results" / f"{out.stem}.csv"
    make_folder_of(out, "--out")
    make_folder_of(data, "--out")
    references = policy_list.resolve_references(policies, options.list, options.files, fetch=options.fetch)
    plans = {name: _plan(name, policy, policies, options) for name, policy in references.items()}
    results = _results({name: _run(plan) for name, plan in plans.items()}, policies.ours, options.reference)
    robots = {name: plan.policies[0].policy.robot for name, plan in plans.items()}
    page = leaderboard_page.render_page(results, policies, robots, _made_by(options, results))
    write_atomically(out, page.encode())
    rows = [
        {"scenario": scenario, "policy": policy, **flatten_entry(nan_to_null(asdict(summary)))}
        for (scenario, policy), summary in results.summaries.items()
    ]
    write_atomically(data, to_csv(rows))
    differences = [
        flatten_entry(nan_to_null(asdict(comparison)))
        for comparison in results.comparisons
        if comparison.b == results.baseline
    ]
    write_atomically(data.with_stem(f"{out.stem}_differences"), to_csv(differences))
    print(out)
    return 0


def _made_by(options: LeaderboardOptions, results: Results) -> str:
    """Return a line of Markdown with the command that produced the page, and with software versions."""
    words = ["python -m research leaderboard", options.list.as_posix()]
    defaults = LeaderboardOptions(options.list)
    for name in ("reference", "scenarios", "episodes"):
        value = getattr(options, name)
        if value != getattr(defaults, name):
            words += [f"--{name}", *map(str, value if isinstance(value, tuple) else (value,))]
    return f"`{' '.join(words)}`; MuJoCo {results.versions['mujoco']}, Python {results.versions['python']}."


def _plan(name: str, policy: str, policies: PolicyList, options: LeaderboardOptions) -> Plan:
    """Create and check the plan of the evaluation of one policy.

    If an evaluation of this policy was started earlier, the plan continues it.

    Args:
        name: Name of the policy on the leaderboard.
        policy: Reference to the policy, as in the option `--policies` of `python -m evaluate`.
        policies: List of all policies of the leaderboard.
        options: Options of the command.

    Returns:
        The plan, which can be executed.

    Raises:
        UsageError: The plan is invalid.
    """
    out = options.runs / options.list.stem / re.sub(r"[^\w.-]+", "_", name)
    servo = ""
    if name in policies.ours:
        policy, _, servo = policy.partition(" at ")
    plan_options = evaluation.EvaluateOptions(
        (policy,),
        robot=policies.robot,
        servo=servo,
        out=out,
        resume=(out / manifest.NAME).is_file(),
        trust=options.trust,
        scenarios=options.scenarios,
        episodes=options.episodes,
        threads=options.threads,
    )
    try:
        return check(plan_options)
    except UsageError as error:
        remedy = f"; or delete {out}" if plan_options.resume else ""
        raise UsageError(f"{name}: {error}{remedy}") from error


def _run(plan: Plan) -> Run:
    """Run the evaluation that `plan` defines, if it is not finished, and return the stored evaluation.

    The function raises UsageError if the evaluation cannot be run, and KeyboardInterrupt after Ctrl-C.
    """
    out = plan.options.out
    if not plan.options.resume or not read_run(out).complete:
        execute(plan, lambda *_: None)
    return read_run(out)


def _results(runs: Mapping[str, Run], ours: Sequence[str], reference: str | None) -> Results:
    """Compare all policies with a reference policy.

    Args:
        runs: Name of a policy -> finished evaluation of this policy.
        ours: Names of the policies of this project.
        reference: Name of the reference policy. None for the policy in `ours` with the highest mean success.

    Returns:
        Results of all policies, as if a single evaluation had all of them.
    """
    first = next(iter(runs.values())).manifest
    cells = [replace(cell, policy=name) for name, run in runs.items() for cell in run.cells]
    analyse_cells = partial(analyse, cells, seed=first.seed, episodes=first.episodes, complete=True)
    if reference is None:
        by_success = leaderboard_page.mean_success(analyse_cells(provenance=first.provenance()))
        reference = next((name for name in by_success if name in ours), next(iter(by_success)))
    return analyse_cells(provenance=first.provenance(), baseline=reference)
