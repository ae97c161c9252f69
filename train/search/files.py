"""What a search writes: parameters as JSON, and an account in Markdown of how it was made and what it changed."""

import json
from collections.abc import Collection, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from evaluate.measures.metrics import Measures
from policies.base import CONTROL_PERIOD
from policies.parameters import Parameters
from quad_env.cli.command_line import UsageError
from quad_env.files.writing import write_atomically
from train.search.subject import Effort, Ranges


def as_json(parameters: Any) -> str:
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


def method(program: str, effort: Effort, scenarios: str) -> str:
    """How the search was made, for its account."""
    return (
        f"Written by `{effort.command(program)}`: CMA-ES, {effort.generations} generations of {effort.candidates} "
        f"candidates, {effort.episodes} episodes of {effort.steps * CONTROL_PERIOD:g} s a candidate on each of "
        f"{scenarios}."
    )


def changes(before: Parameters, after: Parameters, ranges: Ranges, fitted: Collection[str] = ()) -> list[str]:
    """Range and values of every parameter, as a table."""
    lines = ["| parameter | range | before | after |", "|---|---|---|---|"]
    for name, old in asdict(before).items():
        otherwise = "fitted" if name in fitted else "fixed"
        span = "{:g} … {:g}".format(*ranges[name]) if name in ranges else otherwise
        lines.append(f"| {name} | {span} | {old:.9g} | {getattr(after, name):.9g} |")
    return lines


def results(rows: Iterable[tuple[str, str, Measures]]) -> list[str]:
    """Measures on each scenario with the parameters before and after, (scenario, which, measures) each, as a table."""
    errors = "velocity error, m/s | mean velocity error, m/s | yaw-rate error, rad/s"
    lines = [f"| scenario | parameters | succeeded | stalled | falls | {errors} |", "|---" * 8 + "|"]
    for name, label, found in rows:
        means = found.velocity_error, found.mean_velocity_error, found.yaw_rate_error
        counts = " | ".join(f"{int(each.sum())}/{len(each)}" for each in (found.succeeded, found.stalled, found.fell))
        figures = " | ".join(f"{value.mean():.3f}" for value in means)
        lines.append(f"| {name} | {label} | {counts} | {figures} |")
    return lines
