"""The comparison on the terminal."""

import re
from collections.abc import Sequence
from itertools import groupby

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding

from evaluate.analysis.breaking_points import HALF, breaking_point_text
from evaluate.analysis.comparison import FALL_RATE, METRICS, RATES, SUCCESS_RATE
from evaluate.analysis.ranking import Ranking
from evaluate.analysis.results import Results
from evaluate.analysis.score import SCORES, Score
from evaluate.analysis.severity_levels import SeverityAxis, amount, severity_axes
from evaluate.analysis.summary import Summary
from evaluate.report.console import FittedTable, breaking_names, console_table, name_in_lines, row_name
from evaluate.report.headings import FIRST, NARROW
from evaluate.report.verdict import best_and_worst, lines, unranked, verdict
from quad_env.cli.format import ABSENT, estimate, number, plus_minus, share, with_count

MOST_SCENARIOS = 6
"""Scenarios of which every figure is printed."""
HEAD_WIDTH = 9
"""Characters of a name in a line at the head of a column; the rest goes on below."""


def print_results(results: Results, console: Console) -> None:
    """Print the ranking, then every cell; of more scenarios than a screen holds success alone, and the verdict again,
    which is then on the screen."""
    _print_answers(results, console)
    many = len(results.scenarios) > MOST_SCENARIOS
    console.print(success_table(results) if many else summary_table(results))
    _print_notes(results, console)
    again = escape(breaking_names(verdict(results.ranking), console.width))
    console.print(f"\n[bold]{again}[/bold]\n" if many else "", highlight=False)


def print_levels(results: Results, console: Console) -> None:
    """Print the ranking, success at each level of each axis, and the breaking points."""
    _print_answers(results, console)
    console.print(success_table(results))
    for (axis, of), points in groupby(results.breaking_points, key=lambda each: (each.axis, each.of)):
        found = "; ".join(f"{each.policy} {breaking_point_text(each)}" for each in points)
        console.print(f"\n[bold]{escape(axis)}[/bold]: {HALF[of]}: {escape(found)}", highlight=False)
    _print_notes(results, console)
    console.print()


def print_ranking(ranked: Ranking, console: Console, hardware: Sequence[Score] = ()) -> None:
    """Print the verdict, the ranking and a line for each two neighbours."""
    console.print(f"[bold]{escape(breaking_names(verdict(ranked), console.width))}[/bold]\n", highlight=False)
    if ranked.places:
        console.print(ranking_table(ranked, hardware if not ranked.hardware else ()))
        console.print()
    for line in lines(ranked):
        said = breaking_names(f"- {line}", console.width - 1)
        console.print(Padding(escape(said), (0, 0, 0, 1)), highlight=False)
    console.print()


def _print_answers(results: Results, console: Console) -> None:
    """Print the ranking, and where each policy is best and worst."""
    print_ranking(results.ranking, console, results.hardware_scores)
    for policy, ends in best_and_worst(results).items():
        if words := "; ".join(f"{end} on {of}" for end, of in zip(("best", "worst"), ends, strict=True) if of):
            width = console.width - 2
            named = f"[bold]{escape(breaking_names(policy, width))}[/bold]: {escape(breaking_names(words, width))}"
            console.print(Padding(named, (0, 0, 0, 1)), highlight=False)
    if said := unranked(results):
        console.print(Padding(escape(said), (0, 0, 0, 1)), highlight=False)
    console.print()


def ranking_table(ranked: Ranking, hardware: Sequence[Score] = ()) -> FittedTable:
    """Scores with their intervals, the highest first, and costs of transport."""
    real = {each.policy: share(each.score, each.ci) for each in hardware}
    heads = {FIRST: "policy", "score": "score" if ranked.axes > 1 else "success"}
    heads |= {"real": SCORES[1].replace(" ", "\n")} if real else {}
    heads |= {"cost": "cost of\ntransport"}
    rows = (
        {
            FIRST: row_name(each.policy),
            "score": share(each.success, each.success_ci),
            "real": real.get(each.policy, ABSENT),
            "cost": estimate(each.cost, each.cost_ci, 2).with_interval,
        }
        for each in ranked.places
    )
    title = f"{'with the hardware profile, ' * ranked.hardware}with 95 % intervals"
    return console_table(title, heads, {"": rows})


def _print_notes(results: Results, console: Console) -> None:
    for axis in (axis for axis in severity_axes(results.cells) if axis.note):
        console.print(f"\n[bold]{escape(axis.name)}[/bold]: {escape(axis.note)}", highlight=False)


def success_table(results: Results) -> FittedTable:
    """Success in per cent: an axis a row, below it its severities, the mildest first, and a policy a column."""
    heads = {FIRST: "axis"} | {name: escape(name_in_lines(name, HEAD_WIDTH)) for name in results.policies}
    rows = []
    for axis in severity_axes(results.cells):
        severities = " ".join(amount(level.severity) for level in axis.levels if level.severity)
        below = f"\n   {severities} {escape(axis.unit)}".rstrip()
        cells = {policy: _success(results, axis, policy) for policy in results.policies}
        rows.append({FIRST: f"{row_name(axis.name)}{below}", **cells})
    return console_table("success in % at each severity", heads, {"": rows})


def _success(results: Results, axis: SeverityAxis, policy: str) -> str:
    """`100/92/46`; empty where the policy did not run."""
    ran = [results.summaries.get((level.name, policy)) for level in axis.levels]
    return "/".join(number(100.0 * one.success_rate, 0) if one else ABSENT for one in ran) if any(ran) else ""


def summary_table(results: Results) -> FittedTable:
    """A row for each policy on each scenario, intervals below their figures."""
    title = f"{with_count(results.episodes, 'episode')} each, with 95 % intervals (± half of one)"
    shown = (SUCCESS_RATE, FALL_RATE, "velocity_error", "yaw_rate_error")
    heads = {FIRST: "policy", **{metric: NARROW[metric] for metric in shown}, "cost_of_transport": "cost of\ntransport"}
    groups: dict[str, list[dict[str, str]]] = {scenario: [] for scenario in results.scenarios}
    for (scenario, policy), summary in results.summaries.items():
        groups[scenario].append({FIRST: row_name(policy), **summary_figures(summary, "\n")})
    return console_table(title, heads, groups)


def summary_figures(summary: Summary, end: str) -> dict[str, str]:
    """The figures of one row, by column; `end` stands between a figure and its interval."""
    cells = {"cost_of_transport": number(summary.cost_of_transport, 2)}
    for metric in METRICS:
        value, ci = getattr(summary, metric), getattr(summary, f"{metric}_ci")
        cells[metric] = share(value, ci) if metric in RATES else plus_minus(value, ci)
    return {column: re.sub(r" (?=\[|±)", end, cell) for column, cell in cells.items()}
