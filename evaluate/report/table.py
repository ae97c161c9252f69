"""The comparison on the terminal."""

import re
from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding

from evaluate.analysis.breaking_points import Of, breaking_point_text
from evaluate.analysis.comparison import FALL_RATE, METRICS, RATES, SUCCESS_RATE
from evaluate.analysis.ranking import Ranking
from evaluate.analysis.results import Results
from evaluate.analysis.score import SCORES, Score
from evaluate.analysis.severity_levels import SeverityAxis, amount, place, severity_axes
from evaluate.analysis.summary import Summary
from evaluate.report.console import FittedTable, console_table, row_name
from evaluate.report.headings import FIRST, NARROW, shares
from evaluate.report.verdict import lines, strengths_in_words, unranked, verdict
from quad_env.cli.format import ABSENT, broken, counted, interval, number, share

SHOWN = "success % (falls %)"
MOST_SCENARIOS = 6
"""Scenarios of which every figure is printed."""
HEAD_WIDTH = 9
"""Characters of a name in a line at the head of a column; the rest goes on below."""


def print_results(results: Results, console: Console) -> None:
    """Print the ranking, then every cell.

    Of more scenarios than a screen holds, the shares of successes and of falls on each and the breaking points.
    """
    if len(results.scenarios) > MOST_SCENARIOS:
        print_levels(results, console)
    else:
        _print_answers(results, console)
        console.print(summary_table(results))
        _print_notes(results, console)
    console.print()


def print_ranking(ranked: Ranking, console: Console, hardware: Sequence[Score] = ()) -> None:
    """Print the verdict, the ranking and a line for each two neighbours."""
    console.print(f"[bold]{escape(verdict(ranked))}[/bold]\n", highlight=False)
    if ranked.places:
        console.print(ranking_table(ranked, hardware if not ranked.hardware else ()))
        console.print()
    for line in lines(ranked):
        console.print(Padding(f"- {escape(line)}", (0, 0, 0, 1)), highlight=False)
    console.print()


def _print_answers(results: Results, console: Console) -> None:
    """Print the ranking, and where each policy is best and worst."""
    print_ranking(results.ranking, console, results.hardware_scores)
    for policy, words in strengths_in_words(results).items():
        console.print(Padding(f"[bold]{escape(policy)}[/bold]: {escape(words)}", (0, 0, 0, 1)), highlight=False)
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
            "cost": f"{number(each.cost, 2)} [{interval(each.cost_ci, 2)}]".removesuffix(f" [{ABSENT}]"),
        }
        for each in ranked.places
    )
    title = f"{'with the hardware profile, ' * ranked.hardware}with 95 % intervals"
    return console_table(title, heads, {"": rows})


def print_levels(results: Results, console: Console) -> None:
    """Print the ranking, successes and falls at each level of each axis and the breaking points, and the verdict again,
    which is then on the screen."""
    _print_answers(results, console)
    axes = severity_axes(results.cells)
    for axis in (axis for axis in axes if len(axis.levels) > 1):
        console.print(level_table(results, axis))
    if single := [axis for axis in axes if len(axis.levels) == 1]:
        console.print(single_table(results, single))
    console.print(f"\n{_widest(results)}", highlight=False)
    _print_notes(results, console)
    console.print(f"\n[bold]{escape(verdict(results.ranking))}[/bold]", highlight=False)


def _print_notes(results: Results, console: Console) -> None:
    for axis in (axis for axis in severity_axes(results.cells) if axis.note):
        console.print(f"\n[bold]{escape(axis.name)}[/bold]: {escape(axis.note)}", highlight=False)


def level_table(results: Results, axis: SeverityAxis) -> FittedTable:
    """Successes and falls in per cent on each level of an axis, and where half no longer succeed, and fall."""
    half = {
        (point.policy, point.of): breaking_point_text(point)
        for point in results.breaking_points
        if point.axis == axis.name
    }
    heads = {FIRST: "policy", **{level.name: amount(level.severity) for level in axis.levels}}
    rows = []
    for policy in results.policies:
        found = {level.name: results.summaries.get((level.name, policy)) for level in axis.levels}
        lines: tuple[tuple[Of, str, str], ...] = (
            ("success", SUCCESS_RATE, row_name(policy)),
            ("falls", FALL_RATE, "   falls"),
        )
        for of, rate, words in lines if any(found.values()) else ():
            shares = {name: _percent(getattr(s, rate)) if s else "" for name, s in found.items()}
            rows.append({FIRST: words, **shares, "half": half.get((policy, of), "")})
    title = f"[bold]{escape(axis.name)}[/bold]: success in %, and falls, at {escape(axis.quantity)}"
    return console_table(title, heads | ({"half": "half at"} if half else {}), {"": rows})


def single_table(results: Results, single: Sequence[SeverityAxis]) -> FittedTable:
    """Successes and falls in per cent: a scenario a row, a policy a column."""
    places = {axis.scenario_names[0]: escape(place(axis.scenarios[0])) for axis in single}
    ran = {(name, policy): shares(of) for (name, policy), of in results.summaries.items() if name in places}
    policies = [policy for policy in results.policies if any(policy == each for _, each in ran)]
    rows = (
        {FIRST: f" {words}"} | {policy: ran.get((name, policy), "") for policy in policies}
        for name, words in places.items()
    )
    names = {policy: escape("\n".join(broken(policy, HEAD_WIDTH))) for policy in policies}
    return console_table(SHOWN, {FIRST: "scenario", **names}, {"": rows})


def _widest(results: Results) -> str:
    """How far the intervals of all these shares reach."""
    found = results.summaries.values()
    ends = [(s.success_rate, end) for s in found for end in s.success_rate_ci]
    ends += [(s.fall_rate, end) for s in found for end in s.fall_rate_ci]
    reach = number(100.0 * max(abs(end - rate) for rate, end in ends), 0)
    return f"95 % intervals of these shares (Wilson): at most {reach} points to either side; each is in the report"


def summary_table(results: Results) -> FittedTable:
    """A row for each policy on each scenario, intervals below their figures."""
    title = f"{counted(results.episodes, 'episode')} each, with 95 % intervals (± half of one)"
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
        cells[metric] = share(value, ci) if metric in RATES else f"{number(value)} ± {number((ci[1] - ci[0]) / 2)}"
    return {column: re.sub(r" (?=\[|±)", end, cell) for column, cell in cells.items()}


def _percent(share: float) -> str:
    return number(100.0 * share, 0)
