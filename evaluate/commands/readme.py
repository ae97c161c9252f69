"""The README's results table: `python -m evaluate readme results/evaluation/results.json` writes it in its place."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from evaluate.analysis.breaking_point_text import breaking_point_text
from evaluate.analysis.breaking_points import AxisBreakingPoint
from evaluate.analysis.sensitivity import LEAD, Sensitivity, effect_text
from evaluate.analysis.severity_levels import amount
from evaluate.commands.options import Options as Evaluation
from evaluate.rollouts.battery import BATTERIES
from evaluate.rollouts.hardware import IDEAL
from evaluate.terminal.command_line import UsageError
from evaluate.terminal.format import ABSENT, interval, number, percent, percent_interval
from policies.files import write_atomically

SHOWN = ("flat", "push", "rough")
"""Scenarios of the table; all of them in a run without these."""
BEGIN, END = "<!-- results -->", "<!-- /results -->"


@dataclass(frozen=True)
class Options:
    """Write the results table into the README."""

    results: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation/results.json")
    """results.json of an evaluation."""
    readme: Path = Path("README.md")
    """File with the lines `<!-- results -->` and `<!-- /results -->`, between which the table goes."""


def main(options: Options) -> int:
    """Write the table; the exit code."""
    try:
        text = options.readme.read_text()
    except UnicodeError as error:
        raise UsageError(f"{options.readme} is no text ({error})") from error
    write_atomically(options.readme, insert(text, _table_of(options.results)).encode())
    return 0


def _table_of(path: Path) -> str:
    """The table of a results.json; UsageError where it is none, or lacks something."""
    try:
        return table(json.loads(path.read_bytes()))
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path} is not a results.json of `python -m evaluate` ({error!r})") from error


def insert(text: str, lines: str) -> str:
    """The text with the lines between the markers; UsageError where it has none."""
    if BEGIN not in text or END not in text:
        raise UsageError(f"no {BEGIN} and {END} in the README")
    head, rest = text.split(BEGIN, 1)
    return f"{head}{BEGIN}\n{lines}\n{END}{rest.split(END, 1)[1]}"


def table(found: dict[str, Any]) -> str:
    """The comparison as a Markdown table, breaking points below it, and the command that makes them."""
    names = list(found["policies"])
    run = list(dict.fromkeys(name for policy in found["policies"].values() for name in policy["scenarios"]))
    scenarios = [name for name in run if name in SHOWN] or run
    lines = [
        "In brackets 95 % intervals.",
        "",
        "| scenario | policy | falls | velocity error, m/s | yaw-rate error, rad/s | mean velocity error, m/s |",
        "|---|---|---|---|---|---|",
    ]
    for scenario in scenarios:
        lines += [f"| {scenario} | `{name}` | {row(_cell(found, name, scenario))} |" for name in names]
    if found["breaking_points"]:
        lines += ["", *breaking_points(found["breaking_points"], names)]
    if found["sensitivities"]:
        lines += ["", LEAD, "", *effects(found["sensitivities"], names)]
    versions = found["versions"]
    lines += ["", f"`{_command(found, run)}`; MuJoCo {versions['mujoco']}, Python {versions['python']}."]
    return "\n".join(lines)


def _command(found: dict[str, Any], scenarios: list[str]) -> str:
    """What was run, without what is as usual."""
    words = ["python -m evaluate"]
    if tuple(found["policies"]) != Evaluation.policies:
        words += ["--policies", *found["policies"]]
    battery = next((name for name, each in BATTERIES.items() if [one.name for one in each()] == scenarios), None)
    if (battery,) != Evaluation.scenarios:
        words += ["--scenarios", *([battery] if battery else scenarios)]
    for name in ("episodes", "seed"):
        if found[name] != getattr(Evaluation, name):
            words += [f"--{name}", str(found[name])]
    for name, value in found.get("provenance", {}).get("hardware", {}).items():
        if value != getattr(IDEAL, name):
            words += [f"--{name}", value]
    return " ".join(words)


def effects(found: list[dict[str, Any]], names: list[str]) -> list[str]:
    """What each disturbance does: an axis a row, a policy a column."""
    each = [Sensitivity(**_without_null(entry)) for entry in found]
    cells = {(one.axis, one.policy): effect_text(one) for one in each}
    axes = {one.axis: f"{one.axis}, {amount(one.severity, one.unit)}" for one in each}
    return _by_axis("disturbance", axes, cells, names)


def breaking_points(points: list[dict[str, Any]], names: list[str]) -> list[str]:
    """Severity at which half of the episodes end in a fall: an axis a row, a policy a column."""
    cells = {
        (point["axis"], point["policy"]): breaking_point_text(AxisBreakingPoint(**_fields(point))) for point in points
    }
    axes = {point["axis"]: ", ".join(filter(None, (point["axis"], point["unit"]))) for point in points}
    return _by_axis("half of the episodes fall at", axes, cells, names)


def _by_axis(head: str, axes: dict[str, str], cells: dict[tuple[str, str], str], names: list[str]) -> list[str]:
    """A table of cells by axis and policy; `axes` gives each one's words."""
    rows = [
        f"| {words} | {' | '.join(cells.get((axis, name), ABSENT) for name in names)} |" for axis, words in axes.items()
    ]
    return [f"| {head} | {' | '.join(f'`{name}`' for name in names)} |", f"|---|{'---|' * len(names)}", *rows]


def _fields(point: dict[str, Any]) -> dict[str, Any]:
    """Fields of an AxisBreakingPoint; an end that JSON cannot hold is beyond the severities tried."""
    fields: dict[str, Any] = _without_null(point)
    return fields | {"ci": tuple(fields["ci"])}


def _cell(found: dict[str, Any], policy: str, scenario: str) -> dict[str, Any]:
    """Figures of one policy on one scenario, nan where one does not exist; UsageError if the run never got there."""
    cells = found["policies"][policy]["scenarios"]
    if scenario not in cells:
        raise UsageError(f"no figures of {policy} on {scenario}: the evaluation was interrupted; run it to its end")
    figures: dict[str, Any] = _without_null(cells[scenario])
    return figures


def _without_null(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_null(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_without_null(entry) for entry in value]
    return math.nan if value is None else value


def row(cell: dict[str, Any]) -> str:
    """The figures of one policy on one scenario."""
    return " | ".join(
        (
            f"{percent(cell['fall_rate'])} [{percent_interval(cell['fall_rate_ci'])}]",
            f"{number(cell['velocity_error'])} [{interval(cell['velocity_error_ci'])}]",
            f"{number(cell['yaw_rate_error'])} [{interval(cell['yaw_rate_error_ci'])}]",
            number(cell["mean_velocity_error"]),
        )
    )
