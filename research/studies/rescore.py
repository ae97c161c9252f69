"""`python -m research rescore`: falls of a traced evaluation under other rules. Those of success: `evaluate report`."""

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluate.records import trace
from evaluate.records.store import Run, read_run
from evaluate.report.headings import FIRST
from evaluate.report.table import console_table, row_name
from evaluate.statistics.intervals import wilson_interval
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import percent
from quad_env.config import FALL_RULE
from quad_env.files.writing import write_atomically
from research.studies import fall_rules
from research.studies.fall_rules import FallCriterion

FILE = "rescored.json"
Rule = Literal["simple-quad/1", "height-only", "tilt-70", "tilt-90", "trunk-contact", "non-foot-contact"]
Key = tuple[str, str, str]
"""Scenario, policy and rule."""
Figures = dict[str, Any]
"""As the file has them."""
Scores = Mapping[Key, Figures]


@dataclass(frozen=True)
class Options:
    """Apply other rules to an evaluation that was run with --trace; nothing is simulated."""

    results: Annotated[Path, tyro.conf.Positional]
    """Folder of the results."""
    rules: tuple[Rule, ...] = get_args(Rule)
    """Names of fall rules."""


def main(options: Options) -> int:
    """Apply the rules, print and write; the exit code."""
    rules = tuple(map(fall_rules.RULES.__getitem__, options.rules))
    falls = rescore(options.results, rules)
    Console(file=sys.stdout).print(table(falls))
    by_policy: dict[str, dict[str, dict[str, dict[str, Figures]]]] = {}
    for (scenario, policy, rule), figures in falls.items():
        by_policy.setdefault(policy, {"scenarios": {}})["scenarios"].setdefault(scenario, {})[rule] = figures
    contents = {
        "schema": 1,
        "rules": {each.name: {"words": each.words, "source": each.source} for each in rules},
        "policies": by_policy,
    }
    write_atomically(options.results / FILE, (json.dumps(contents, indent=2, allow_nan=False) + "\n").encode())
    return 0


def rescore(results: Path, rules: tuple[FallCriterion, ...]) -> Scores:
    """Falls of every traced cell under every rule; UsageError where there is no trace."""
    run = read_run(results)
    paths = sorted((results / trace.FOLDER).glob("*.parquet"))
    if not paths:
        raise UsageError(f"no traces in {results / trace.FOLDER}; run the evaluation with --trace")
    own = fall_rules.RULES[FALL_RULE]
    times: dict[Key, list[NDArray[np.float64]]] = {}
    for path in paths:
        try:
            header, episodes = trace.read(path, "compact")
        except (KeyError, OSError, TypeError, ValueError) as error:
            raise UsageError(f"cannot read {path}: {error}") from error
        for rule in dict.fromkeys((own, *rules)):
            step = fall_rules.fall_step(rule, episodes)
            time = np.where(step < episodes.steps, (step + 1) * episodes.dt, np.nan)
            times.setdefault((header.scenario, header.policy, rule.name), []).append(time)
    falls = {key: _falls(np.concatenate(parts)) for key, parts in times.items()}
    _check_belong(falls, run, results / trace.FOLDER)
    return {key: figures for key, figures in falls.items() if own in rules or key[2] != own.name}


def _check_belong(falls: Scores, run: Run, folder: Path) -> None:
    """UsageError unless the run has every traced cell, with as many falls as its trace under their own rule."""
    there = {(cell.scenario.name, cell.policy): (cell.episodes, int(cell.measures.fell.sum())) for cell in run.cells}
    for (scenario, policy, rule), figures in falls.items():
        if rule == FALL_RULE and there.get((scenario, policy)) != (figures["episodes"], figures["falls"]):
            other = f"the trace of {policy} on {scenario} is not of these results"
            raise UsageError(f"{other}: delete {folder} and run the evaluation again")


def _falls(time: NDArray[np.float64]) -> Figures:
    """Figures of episodes (n,) by the time of their fall, s, NaN without one."""
    fell = ~np.isnan(time)
    episodes, falls = len(fell), int(fell.sum())
    figures = {"episodes": episodes, "falls": falls, "fall_rate": falls / episodes}
    mean = float(time[fell].mean()) if falls else None
    return figures | {"fall_rate_ci": wilson_interval(falls, episodes), "time_to_fall": mean}


def table(scores: Scores) -> Table:
    """A row for each policy on each scenario, a column for each rule; 80 columns are enough."""
    found: dict[str, dict[str, dict[str, str]]] = {}
    for (scenario, policy, rule), figures in scores.items():
        low, high = (100 * end for end in figures["fall_rate_ci"])
        row = found.setdefault(scenario, {}).setdefault(policy, {FIRST: row_name(policy)})
        row[rule] = f"{percent(figures['fall_rate'])}\n{escape(f'[{low:.0f}, {high:.0f}]')}"
    heads = {FIRST: "policy", **{rule: rule.replace("-", "-\n") for _, _, rule in scores}}
    groups = {scenario: by_policy.values() for scenario, by_policy in found.items()}
    return console_table("falls, with Wilson 95 % intervals", heads, groups)
