"""Tables on the terminal with the results of a run: ranking, success and all metrics."""

import re
from collections.abc import Sequence
from itertools import groupby

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding

from evaluate.analysis.breaking_points import BREAKING_POINT_WORDS, breaking_point_text
from evaluate.analysis.comparison import FALL_RATE, METRICS, RATES, SUCCESS_RATE
from evaluate.analysis.ranking import Ranking
from evaluate.analysis.results import Results
from evaluate.analysis.score import SCORES, Score
from evaluate.analysis.seed_groups import SeedGroup
from evaluate.analysis.severity_levels import SeverityAxis, format_amount, severity_axes
from evaluate.analysis.summary import Summary
from evaluate.report.console import FittedTable, break_long_words, console_table, format_row_name, wrap_name
from evaluate.report.headings import ROW_LABEL, TERMINAL_TITLES
from evaluate.report.verdict import adjacent_pair_lines, best_and_worst, ranking_verdict, unranked_text
from quad_env.cli.format import ABSENT, estimate, number, plus_minus, share, with_count

MAX_DETAILED_SCENARIOS = 6
"""Largest number of scenarios for which the table shows all metrics; for more scenarios, it shows only success."""
HEAD_WIDTH = 9
"""Maximum width of a line of the policy names above the columns of a table, characters."""


def print_results(results: Results, console: Console) -> None:
    """Print the ranking, and then a table of the results, on a `console`.

    The table shows all metrics for up to MAX_DETAILED_SCENARIOS scenarios. For more scenarios it shows only success.
    In this case the sentence with the best policy is printed again below the table, because its first print may have
    scrolled off the screen.

    Args:
        results: Results of a run.
        console: Terminal.
    """
    _print_answers(results, console)
    has_many_scenarios = len(results.scenarios) > MAX_DETAILED_SCENARIOS
    console.print(success_table(results) if has_many_scenarios else summary_table(results))
    _print_notes(results, console)
    verdict = escape(break_long_words(ranking_verdict(results.ranking), console.width))
    console.print(f"\n[bold]{verdict}[/bold]\n" if has_many_scenarios else "", highlight=False)


def print_levels(results: Results, console: Console) -> None:
    """Print the ranking, the success at each severity of each disturbance axis, and the breaking points.

    A breaking point is the severity at which half of the episodes no longer succeed.

    Args:
        results: Results of a run with one or more disturbance axes.
        console: Terminal.
    """
    _print_answers(results, console)
    console.print(success_table(results))
    for (axis, kind), points in groupby(results.breaking_points, key=lambda point: (point.axis, point.of)):
        text = "; ".join(f"{point.policy} {breaking_point_text(point)}" for point in points)
        console.print(f"\n[bold]{escape(axis)}[/bold]: {BREAKING_POINT_WORDS[kind]}: {escape(text)}", highlight=False)
    _print_notes(results, console)
    console.print()


def print_ranking(ranked: Ranking, console: Console, hardware: Sequence[Score] = ()) -> None:
    """Print a sentence with the best policy, the ranking, and a line for each pair of adjacent policies.

    Args:
        ranked: Ranking of the policies.
        console: Terminal.
        hardware: Scores of the policies with the hardware profile, for an additional column.
    """
    verdict = escape(break_long_words(ranking_verdict(ranked), console.width))
    console.print(f"[bold]{verdict}[/bold]\n", highlight=False)
    if ranked.places:
        console.print(ranking_table(ranked, hardware if not ranked.hardware else ()))
        console.print()
    for line in adjacent_pair_lines(ranked):
        _print_indented(escape(break_long_words(f"- {line}", console.width - 1)), console)
    console.print()


def _print_indented(markup: str, console: Console) -> None:
    """Print a text, `markup` of the library rich, with an indentation of one character."""
    console.print(Padding(markup, (0, 0, 0, 1)), highlight=False)


def _print_answers(results: Results, console: Console) -> None:
    """Print the ranking, the best and worst disturbance axes of each policy, and the unranked policies."""
    print_ranking(results.ranking, console, results.hardware_scores)
    width = console.width - 2
    for policy, (best, worst) in best_and_worst(results).items():
        texts = [f"best on {best}"] if best else []
        texts += [f"worst on {worst}"] if worst else []
        if texts:
            name = f"[bold]{escape(break_long_words(policy, width))}[/bold]"
            _print_indented(f"{name}: {escape(break_long_words('; '.join(texts), width))}", console)
    if unranked := unranked_text(results):
        _print_indented(escape(unranked), console)
    console.print()
    if results.groups:
        console.print(group_table(results.groups))
        console.print()


def ranking_table(ranked: Ranking, hardware: Sequence[Score] = ()) -> FittedTable:
    """Create the table of the ranking: scores with intervals, the highest first, and costs of transport.

    Args:
        ranked: Ranking of the policies.
        hardware: Scores of the policies with the hardware profile, for an additional column.

    Returns:
        The table.
    """
    hardware_cells = {score.policy: share(score.score, score.ci) for score in hardware}
    heads = {ROW_LABEL: "policy", "score": "score" if ranked.axes > 1 else "success"}
    if hardware_cells:
        heads["hardware"] = SCORES[1].replace(" ", "\n")
    heads["cost"] = "cost of\ntransport"
    rows = (
        {
            ROW_LABEL: format_row_name(place.policy),
            "score": share(place.success, place.success_ci),
            "hardware": hardware_cells.get(place.policy, ABSENT),
            "cost": estimate(place.cost, place.cost_ci, 2).with_interval,
        }
        for place in ranked.places
    )
    profile = "with the hardware profile, " if ranked.hardware else ""
    return console_table(f"{profile}with 95 % intervals", heads, {"": rows})


def group_table(groups: Sequence[SeedGroup]) -> FittedTable:
    """Create the table of the groups of training seeds: mean score, interquartile mean and cost of transport."""
    heads = {ROW_LABEL: "training", "score": "score", "score_iqm": "interquartile\nmean"}
    if any(group.hardware_score for group in groups):
        heads |= {"hardware": SCORES[1].replace(" ", "\n"), "hardware_iqm": "interquartile\nmean"}
    heads["cost"] = "cost of\ntransport"
    rows = []
    for group in groups:
        name = f"{format_row_name(group.name)}, {with_count(len(group.policies), 'seed')}"
        cells = dict.fromkeys(heads, ABSENT) | {ROW_LABEL: name}
        for column, score in (("score", group.score), ("hardware", group.hardware_score)):
            if score is not None:
                cells[column] = share(score.score, score.ci)
                cells[f"{column}_iqm"] = share(score.interquartile_mean, score.interquartile_mean_ci)
        cells["cost"] = estimate(group.cost_of_transport, group.cost_of_transport_ci, 2).with_interval
        rows.append(cells)
    return console_table("groups, with 95 % intervals over training seeds and episodes", heads, {"": rows})


def _print_notes(results: Results, console: Console) -> None:
    """Print the notes of disturbance axes: influences on the results other than the policy."""
    for axis in (axis for axis in severity_axes(results.cells) if axis.note):
        console.print(f"\n[bold]{escape(axis.name)}[/bold]: {escape(axis.note)}", highlight=False)


def success_table(results: Results) -> FittedTable:
    """Create the table of success, %: a row for each disturbance axis, a column for each policy.

    A cell contains the success rate at each severity of the axis in the run.
    """
    heads = {ROW_LABEL: "axis"} | {name: escape(wrap_name(name, HEAD_WIDTH)) for name in results.policies}
    rows = []
    for axis in severity_axes(results.cells):
        severities = " ".join(format_amount(level.severity) for level in axis.levels if level.severity)
        below = f"\n   {severities} {escape(axis.unit)}".rstrip()
        cells = {policy: _success(results, axis, policy) for policy in results.policies}
        rows.append({ROW_LABEL: f"{format_row_name(axis.name)}{below}", **cells})
    return console_table("success in % at each severity", heads, {"": rows})


def _success(results: Results, axis: SeverityAxis, policy: str) -> str:
    """Format the success rates, %, of a policy at the severities of an `axis`, such as `100/92/46`.

    The text is empty if the policy did not run on the axis.
    """
    summaries = [results.summaries.get((level.name, policy)) for level in axis.levels]
    if not any(summaries):
        return ""
    return "/".join(number(100.0 * summary.success_rate, 0) if summary else ABSENT for summary in summaries)


def summary_table(results: Results) -> FittedTable:
    """Create the table of all metrics: a row for each policy on each scenario, intervals below values."""
    title = f"{with_count(results.episodes, 'episode')} each, with 95 % intervals (± half of one)"
    heads = {ROW_LABEL: "policy"}
    for metric in (SUCCESS_RATE, FALL_RATE, "velocity_error", "yaw_rate_error"):
        heads[metric] = TERMINAL_TITLES[metric]
    heads["cost_of_transport"] = "cost of\ntransport"
    groups: dict[str, list[dict[str, str]]] = {scenario: [] for scenario in results.scenarios}
    for (scenario, policy), summary in results.summaries.items():
        groups[scenario].append({ROW_LABEL: format_row_name(policy), **summary_figures(summary, "\n")})
    return console_table(title, heads, groups)


def summary_figures(summary: Summary, end: str) -> dict[str, str]:
    """Format the metrics and the cost of transport of one table row.

    Args:
        summary: Summary of a policy on a scenario.
        end: Text between a value and its interval.

    Returns:
        Name of a metric -> text of its value and interval.
    """
    cells = {"cost_of_transport": number(summary.cost_of_transport, 2)}
    for metric in METRICS:
        value = getattr(summary, metric)
        ci = getattr(summary, f"{metric}_ci")
        cells[metric] = share(value, ci) if metric in RATES else plus_minus(value, ci)
    return {column: re.sub(r" (?=\[|±)", end, cell) for column, cell in cells.items()}
