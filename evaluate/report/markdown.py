"""`report.md`: the outcome for a pull request or a README, as Markdown that GitHub shows."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from evaluate.analysis.breaking_points import CAVEAT, HALF, breaking_point_text
from evaluate.analysis.comparison import FALL_RATE, RATES, SUCCESS_RATE
from evaluate.analysis.findings import headline
from evaluate.analysis.gates import GateResult
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, severity, severity_axes
from evaluate.analysis.summary import Summary
from evaluate.report.headings import FIRST, IN_A_LINE
from evaluate.report.notes import extent, warnings
from evaluate.rollouts.hardware import words
from quad_env.cli.format import ABSENT, interval, number, share
from quad_env.files.writing import write_atomically

FIGURES = (SUCCESS_RATE, FALL_RATE, "velocity_error", "yaw_rate_error")
"""Metrics that the tables of figures show."""


def write(results: Results, path: Path, gates: Sequence[GateResult] = ()) -> None:
    """Write report.md."""
    write_atomically(path, render(results, gates).encode())


def render(results: Results, gates: Sequence[GateResult] = ()) -> str:
    """The whole text."""
    parts = [_head(results)]
    if gates:
        parts.append("### Gates\n\n" + "\n".join(f"- {_plain(each.line)}" for each in gates))
    parts += [*_breaking_points(results), CAVEAT] if results.breaking_points else []
    parts += [_folded(results, axis) for axis in severity_axes(results.cells)]
    return "\n\n".join(parts) + "\n"


def table(heads: Mapping[str, str], rows: Iterable[Mapping[str, str]]) -> str:
    """A Markdown table: headings, and the cells of each row, by column; the first column to the left."""
    first, *rest = (f"| {' | '.join(row[column] for column in heads)} |" for row in (heads, *rows))
    return "\n".join([first, f"|---|{'---:|' * (len(heads) - 1)}", *rest])


def _head(results: Results) -> str:
    interrupted = "" if results.complete else "**Interrupted: this is the part that was done.**\n\n"
    known = "".join(f"**{_plain(line)}.**\n\n" for line in warnings(results))
    first = "\n".join(f"- **{lead}** {' '.join(rest)}".rstrip() for lead, *rest in headline(results))
    how = f"seed {results.seed}; in brackets 95 % intervals.{words(results.hardware)}"
    return f"## Evaluation\n\n{interrupted}{known}{first}\n\n{extent(results)}; {how}"


def _plain(text: str) -> str:
    """A text of a user's, in which Markdown sees no marks of its own."""
    return re.sub(r"([\\`*_<>\[\]])", r"\\\1", text)


def _breaking_points(results: Results) -> Iterator[str]:
    """Severities at which half of the episodes fail: an axis a row, a policy a column."""
    for of, head in HALF.items():
        found = {(p.axis, p.policy): breaking_point_text(p) for p in results.breaking_points if p.of == of}
        axes, policies = (list(dict.fromkeys(each)) for each in zip(*found, strict=True))
        rows = [{FIRST: axis, **{each: found.get((axis, each), ABSENT) for each in policies}} for axis in axes]
        yield table({FIRST: head, **{policy: f"`{policy}`" for policy in policies}}, rows)


def _folded(results: Results, axis: SeverityAxis) -> str:
    rows = [
        {FIRST: severity(level), "policy": f"`{policy}`", **_figures(results.summaries[level.name, policy])}
        for level in axis.levels
        for policy in results.policies
        if (level.name, policy) in results.summaries
    ]
    heads = {FIRST: axis.name, "policy": "policy", **{metric: IN_A_LINE[metric] for metric in FIGURES}}
    return _details(f"{axis.name}: figures", table(heads, rows))


def _figures(summary: Summary) -> dict[str, str]:
    """Metric -> its figure with the interval."""
    return {
        metric: share(value, ci) if metric in RATES else f"{number(value)} [{interval(ci)}]"
        for metric in FIGURES
        for value, ci in [(getattr(summary, metric), getattr(summary, f"{metric}_ci"))]
    }


def _details(title: str, body: str) -> str:
    return f"<details><summary>{title}</summary>\n\n{body}\n\n</details>"
