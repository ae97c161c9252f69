"""`python -m research rescore`: falls and successes of a traced evaluation under other rules."""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluate.measures import outcomes
from evaluate.measures.metrics import outcome
from evaluate.measures.outcomes import SuccessRule
from evaluate.records import trace
from evaluate.records.store import Run, read_run
from evaluate.report.headings import FIRST
from evaluate.report.table import console_table, row_name
from evaluate.statistics.intervals import Interval, wilson_interval
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import percent
from quad_env.config import FALL_RULE
from quad_env.files.writing import write_atomically
from research.studies import fall_rules
from research.studies.fall_rules import FallCriterion

FILE = "rescored.json"
Rule = TypeVar("Rule")


@dataclass(frozen=True)
class Options:
    """Apply other rules to an evaluation that was run with --trace; nothing is simulated."""

    results: Annotated[Path, tyro.conf.Positional]
    """Folder of the results."""
    rules: tuple[str, ...] = ("all",)
    """Names of fall rules: simple-quad/1, height-only, tilt-70, tilt-90, trunk-contact, non-foot-contact; or all."""
    success: tuple[str, ...] = ("all",)
    """Names of rules of success: success/2, success/1, success-half, success-double, survival; or all."""


@dataclass(frozen=True)
class Score:
    """Falls, or successes, of one policy on one scenario under one rule."""

    policy: str
    scenario: str
    rule: str
    count: int
    """Episodes that fell, or succeeded."""
    rate: float
    rate_ci: Interval
    """Wilson, 95 %."""
    figures: dict[str, Any]
    """All figures of the score for the file."""


def main(options: Options) -> int:
    """Apply the rules, print and write; the exit code."""
    rules = _chosen(fall_rules.RULES, options.rules, "--rules")
    of_success = _chosen(outcomes.RULES, options.success, "--success")
    falls, successes = rescore(options.results, rules, of_success)
    console = Console(file=sys.stdout)
    console.print(table("success", [rule.name for rule in of_success], successes))
    console.print(table("falls", [rule.name for rule in rules], falls))
    write(falls, rules, successes, of_success, options.results / FILE)
    return 0


def _chosen(rules: Mapping[str, Rule], names: tuple[str, ...], option: str) -> tuple[Rule, ...]:
    """The rules of those names, every one for `all`; UsageError lists the valid names."""
    if unknown := [name for name in names if name not in rules and names != ("all",)]:
        raise UsageError(f"{option}: unknown rule {unknown[0]!r}; valid: {', '.join(rules)}, or all")
    return tuple(rules[name] for name in (rules if names == ("all",) else names))


def rescore(
    results: Path, rules: tuple[FallCriterion, ...], of_success: tuple[SuccessRule, ...]
) -> tuple[list[Score], list[Score]]:
    """Falls and successes of every traced cell under every rule; UsageError where there is no trace."""
    run = read_run(results)
    paths = sorted((results / trace.FOLDER).glob("*.parquet"))
    if not paths:
        raise UsageError(f"no traces in {results / trace.FOLDER}; run the evaluation with --trace")
    steps: dict[tuple[str, str, str], list[NDArray[np.float64]]] = {}
    found: dict[tuple[str, str, str], list[NDArray[np.object_]]] = {}
    for path in paths:
        try:
            header, episodes = trace.read(path, "compact")
        except (KeyError, OSError, TypeError, ValueError) as error:
            raise UsageError(f"cannot read {path}: {error}") from error
        for rule in {FALL_RULE: fall_rules.RULES[FALL_RULE], **{rule.name: rule for rule in rules}}.values():
            step = fall_rules.fall_step(rule, episodes)
            time = np.where(step < episodes.steps, (step + 1) * episodes.dt, np.nan)
            steps.setdefault((header.scenario, header.policy, rule.name), []).append(time)
        for rule_of_success in of_success:
            key = (header.scenario, header.policy, rule_of_success.name)
            found.setdefault(key, []).append(outcome(episodes, rule_of_success))
    scores = [_falls(*key, np.concatenate(times)) for key, times in steps.items()]
    _check_belong(scores, run, results / trace.FOLDER)
    wanted = {rule.name for rule in rules}
    successes = [_successes(*key, np.concatenate(parts)) for key, parts in found.items()]
    return [score for score in scores if score.rule in wanted], successes


def _check_belong(scores: list[Score], run: Run, folder: Path) -> None:
    """UsageError unless the run has every traced cell, with as many falls as its trace under their own rule."""
    there = {(cell.policy, cell.scenario.name): (cell.episodes, int(cell.measures.fell.sum())) for cell in run.cells}
    for score in scores:
        found = score.figures["episodes"], score.count
        if score.rule == FALL_RULE and there.get((score.policy, score.scenario)) != found:
            raise UsageError(
                f"the trace of {score.policy} on {score.scenario} is not of these results: "
                f"delete {folder} and run the evaluation again"
            )


def _falls(scenario: str, policy: str, rule: str, time: NDArray[np.float64]) -> Score:
    fell = ~np.isnan(time)
    more = {"time_to_fall": float(time[fell].mean()) if fell.any() else None}  # mean over the episodes that fell, s
    return _score((policy, scenario, rule), fell, ("falls", "fall_rate"), more)


def _successes(scenario: str, policy: str, rule: str, found: NDArray[np.object_]) -> Score:
    more = {"outcomes": {name: int((found == name).sum()) for name in outcomes.RULES[rule].outcomes}}
    return _score((policy, scenario, rule), found == outcomes.SUCCEEDED, ("successes", "success_rate"), more)


def _score(of: tuple[str, str, str], counted: NDArray[np.bool_], names: tuple[str, str], more: dict[str, Any]) -> Score:
    """The score of episodes (n,) that are counted or not; `names` are those of count and rate in the file."""
    episodes, count = len(counted), int(counted.sum())
    rate, interval = count / episodes, wilson_interval(count, episodes)
    figures = {"episodes": episodes, names[0]: count, names[1]: rate, f"{names[1]}_ci": interval, **more}
    return Score(*of, count, rate, interval, figures)


def table(what: str, rules: Sequence[str], scores: Sequence[Score]) -> Table:
    """A row for each policy on each scenario, a column for each rule; 80 columns are enough."""
    found: dict[str, dict[str, dict[str, str]]] = {}
    for score in scores:
        row = found.setdefault(score.scenario, {}).setdefault(score.policy, {FIRST: row_name(score.policy)})
        row[score.rule] = _shown(score)
    heads = {FIRST: "policy", **{rule: rule.replace("-", "-\n") for rule in rules}}
    groups = {scenario: by_policy.values() for scenario, by_policy in found.items()}
    return console_table(f"{what}, with Wilson 95 % intervals", heads, groups)


def write(
    falls: Sequence[Score],
    rules: Sequence[FallCriterion],
    successes: Sequence[Score],
    of_success: Sequence[SuccessRule],
    path: Path,
) -> None:
    """Write the scores and what the rules mean."""
    contents = {
        "schema": 1,
        "rules": {rule.name: {"words": rule.words, "source": rule.source} for rule in rules},
        "policies": _by_policy(falls),
        "success": {
            "rules": {rule.name: {"words": rule.words} for rule in of_success},
            "policies": _by_policy(successes),
        },
    }
    write_atomically(path, (json.dumps(contents, indent=2, allow_nan=False) + "\n").encode())


def _by_policy(scores: Sequence[Score]) -> dict[str, dict[str, dict[str, dict[str, Any]]]]:
    """Policy -> "scenarios" -> scenario -> rule -> figures."""
    policies: dict[str, dict[str, dict[str, dict[str, Any]]]] = {}
    for score in scores:
        scenarios = policies.setdefault(score.policy, {"scenarios": {}})["scenarios"]
        scenarios.setdefault(score.scenario, {})[score.rule] = score.figures
    return policies


def _shown(score: Score) -> str:
    low, high = score.rate_ci
    return f"{percent(score.rate)}\n{escape(f'[{100 * low:.0f}, {100 * high:.0f}]')}"
