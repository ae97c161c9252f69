"""The comparison as a table on the terminal."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluate.analysis.breaking_point_text import breaking_point_text
from evaluate.analysis.comparison import ERRORS, FALL_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, place, severity_axes
from evaluate.analysis.summary import Summary
from evaluate.terminal.format import counted, number, p_value, points, share

MOST_SCENARIOS = 6
"""Scenarios of which every figure is printed."""


def print_results(results: Results, console: Console) -> None:
    """Print every cell, and every policy's difference from the baseline; 80 columns are enough.

    Of more scenarios than a screen holds, the share of falls on each and the breaking points.
    """
    if len(results.scenarios) > MOST_SCENARIOS:
        graded = [axis for axis in severity_axes(results) if len(axis.levels) > 1]
        for axis in graded:
            console.print(falls_table(results, axis))
        if single := [axis for axis in severity_axes(results) if len(axis.levels) == 1]:
            console.print(single_table(results, single))
        console.print(f"\n{_widest(results)}", highlight=False)
        console.print()
        return
    console.print(summary_table(results))
    if results.against_baseline:
        console.print()
        console.print(difference_table(results))
    console.print()


def falls_table(results: Results, axis: SeverityAxis) -> Table:
    """Falls in per cent on each level of an axis, and the breaking point."""
    breaking_points = {point.policy: point for point in results.breaking_points if point.axis == axis.name}
    table = _table(f"[bold]{escape(axis.name)}[/bold]: falls in % at {escape(axis.quantity)}")
    for level in axis.levels:
        table.add_column(f"{level.severity:g}", justify="right")
    if breaking_points:
        table.add_column("half fall at")
    for policy in results.policies:
        found = [results.summaries.get((level.name, policy)) for level in axis.levels]
        shares = ["" if summary is None else number(100.0 * summary.fall_rate, 0) for summary in found]
        where = [breaking_point_text(breaking_points[policy])] if policy in breaking_points else []
        table.add_row(f" {escape(policy)}", *shares, *where)
    return table


def single_table(results: Results, single: Sequence[SeverityAxis]) -> Table:
    """Falls in per cent: a scenario a row, a policy a column."""
    table = _table("falls in %", "scenario")
    for policy in results.policies:
        table.add_column(escape(policy), justify="right", overflow="fold")
    for axis in single:
        found = [results.summaries.get((axis.scenario_names[0], policy)) for policy in results.policies]
        shares = ["" if summary is None else number(100.0 * summary.fall_rate, 0) for summary in found]
        table.add_row(f" {escape(place(axis.scenarios[0]))}", *shares)
    return table


def _widest(results: Results) -> str:
    """How far the intervals of all these shares reach."""
    ends = [(figures.fall_rate, end) for figures in results.summaries.values() for end in figures.fall_rate_ci]
    reach = number(100.0 * max(abs(end - rate) for rate, end in ends), 0)
    return f"95 % intervals of falls (Wilson): at most {reach} points to either side; each is in the report"


def summary_table(results: Results) -> Table:
    """A row for each policy on each scenario."""
    table = _table(f"{counted(results.episodes, 'episode')} each, with 95 % intervals (± half of one)")
    for name in ("falls", "velocity\nerror m/s", "yaw-rate\nerror rad/s", "mean vel.\nerror m/s", "cost of\ntransport"):
        table.add_column(name, justify="right")
    for scenario in results.scenarios:
        table.add_row(f"[bold]{escape(scenario)}[/bold]")
        for policy in results.policies:
            if summary := results.summaries.get((scenario, policy)):
                table.add_row(f" {escape(policy)}", *summary_figures(summary))
    return table


def summary_figures(summary: Summary) -> tuple[str, ...]:
    """The figures of one row."""
    return (
        share(summary.fall_rate, summary.fall_rate_ci),
        _spread(summary.velocity_error, summary.velocity_error_ci),
        _spread(summary.yaw_rate_error, summary.yaw_rate_error_ci),
        number(summary.mean_velocity_error),
        number(summary.cost_of_transport, 2),
    )


def difference_table(results: Results) -> Table:
    """A row for each policy on each scenario: its difference from the baseline, with the corrected p-value below."""
    title = f"minus {results.baseline}, paired by episode; below zero is better\np corrected for their number (Holm)"
    table = _table(title)
    for name in ("falls\n% points", "velocity\nerror m/s", "yaw-rate\nerror rad/s", "mean vel.\nerror m/s"):
        table.add_column(name, justify="right")
    rows: dict[str, dict[str, dict[str, str]]] = {}
    for comparison in results.against_baseline:
        by_policy = rows.setdefault(comparison.scenario, {})
        by_policy.setdefault(comparison.a, {})[comparison.metric] = _difference(comparison)
    for scenario, by_policy in rows.items():
        table.add_row(f"[bold]{escape(scenario)}[/bold]")
        for policy, cells in by_policy.items():
            table.add_row(f" {escape(policy)}", *(cells[metric] for metric in (FALL_RATE, *ERRORS)))
    return table


def _table(title: str, first: str = "policy") -> Table:
    table = Table(
        title=title, title_justify="left", title_style="", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False
    )
    table.add_column(first, overflow="fold")
    return table


def _difference(comparison: Comparison) -> str:
    value = comparison.difference
    shown = points(value) if comparison.metric == FALL_RATE else number(value)
    return f"{shown}\n{p_value(comparison.p_value_holm)}"


def _spread(mean: float, ci: tuple[float, float]) -> str:
    return f"{number(mean)} ± {number((ci[1] - ci[0]) / 2)}"
