"""The comparison as a table on the terminal."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluate.analysis.breaking_point_text import HALF, breaking_point_text
from evaluate.analysis.comparison import METRICS, RATES, SUCCESS_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, amount, place, severity_axes
from evaluate.analysis.summary import Summary
from evaluate.analysis.training_seeds import SeedSpread, seed_spreads
from evaluate.terminal.format import counted, number, p_value, percent, points, share

SHOWN = "success % (falls %)"
MOST_SCENARIOS = 6
"""Scenarios of which every figure is printed."""
_ERRORS = ("velocity\nerror m/s", "yaw-rate\nerror rad/s", "mean vel.\nerror m/s")
FIGURES = ("success", "falls", *_ERRORS)
"""Headings of the METRICS."""
DIFFERENCES = ("success\n% points", "falls\n% points", *_ERRORS)
"""Headings of their differences."""


def print_results(results: Results, console: Console) -> None:
    """Print every cell, every policy's difference from the baseline and the training seeds; 80 columns are enough.

    Of more scenarios than a screen holds, the shares of successes and of falls on each and the breaking points.
    """
    if len(results.scenarios) > MOST_SCENARIOS:
        print_levels(results, console)
    else:
        console.print(summary_table(results))
        if results.against_baseline:
            console.print()
            console.print(difference_table(results))
    console.print()
    print_spread(results, console)


def print_levels(results: Results, console: Console) -> None:
    """Print successes and falls at each level of each axis, and the breaking points; 80 columns are enough."""
    axes = severity_axes(results.cells)
    for axis in (axis for axis in axes if len(axis.levels) > 1):
        console.print(level_table(results, axis))
    if single := [axis for axis in axes if len(axis.levels) == 1]:
        console.print(single_table(results, single))
    console.print(f"\n{_widest(results)}", highlight=False)


def level_table(results: Results, axis: SeverityAxis) -> Table:
    """Successes and falls in per cent on each level of an axis, and where half no longer succeed, and fall."""
    half = {
        (point.policy, point.of): breaking_point_text(point)
        for point in results.breaking_points
        if point.axis == axis.name
    }
    table = console_table(f"[bold]{escape(axis.name)}[/bold]: success in %, and falls, at {escape(axis.quantity)}")
    for level in axis.levels:
        table.add_column(amount(level.severity), justify="right")
    if half:
        table.add_column("half at")
    for policy in results.policies:
        found = [results.summaries.get((level.name, policy)) for level in axis.levels]
        if not any(found):
            continue
        where = [[half[policy, of]] if (policy, of) in half else [] for of in HALF]
        table.add_row(f" {escape(policy)}", *(_percent(s.success_rate) if s else "" for s in found), *where[0])
        table.add_row("   falls", *(_percent(s.fall_rate) if s else "" for s in found), *where[1])
    return table


def print_breaking_points(results: Results, console: Console) -> None:
    """Print where half of the episodes no longer succeed, and fall: a policy a row, and how many levels it ran."""
    for axis in severity_axes(results.cells):
        table = console_table(f"[bold]{escape(axis.name)}[/bold]: {escape(axis.quantity)}")
        for head in ("levels", *HALF.values()):
            table.add_column(head, justify="right")
        for policy in results.policies:
            half = {
                p.of: breaking_point_text(p)
                for p in results.breaking_points
                if (p.axis, p.policy) == (axis.name, policy)
            }
            ran = sum((level.name, policy) in results.summaries for level in axis.levels)
            table.add_row(f" {escape(policy)}", str(ran), *(half.get(of, "") for of in HALF))
        console.print(table)


def single_table(results: Results, single: Sequence[SeverityAxis]) -> Table:
    """Successes and falls in per cent: a scenario a row, a policy a column."""
    table = console_table(SHOWN, "scenario")
    for policy in results.policies:
        table.add_column(escape(policy), justify="right", overflow="fold")
    for axis in single:
        found = [results.summaries.get((axis.scenario_names[0], policy)) for policy in results.policies]
        shares = map(_shares, found)
        table.add_row(f" {escape(place(axis.scenarios[0]))}", *shares)
    return table


def _widest(results: Results) -> str:
    """How far the intervals of all these shares reach."""
    found = results.summaries.values()
    ends = [(s.success_rate, end) for s in found for end in s.success_rate_ci]
    ends += [(s.fall_rate, end) for s in found for end in s.fall_rate_ci]
    reach = number(100.0 * max(abs(end - rate) for rate, end in ends), 0)
    return f"95 % intervals of these shares (Wilson): at most {reach} points to either side; each is in the report"


def summary_table(results: Results) -> Table:
    """A row for each policy on each scenario."""
    title = f"{counted(results.episodes, 'episode')} each, with 95 % intervals (± half of one)"
    table = console_table(title, "policy", *FIGURES[:-1], "cost of\ntransport")
    for scenario in results.scenarios:
        table.add_row(f"[bold]{escape(scenario)}[/bold]")
        for policy in results.policies:
            if summary := results.summaries.get((scenario, policy)):
                table.add_row(f" {escape(policy)}", *summary_figures(summary))
    return table


def summary_figures(summary: Summary) -> tuple[str, ...]:
    """The figures of one row."""
    return (
        share(summary.success_rate, summary.success_rate_ci),
        share(summary.fall_rate, summary.fall_rate_ci),
        _spread(summary.velocity_error, summary.velocity_error_ci),
        _spread(summary.yaw_rate_error, summary.yaw_rate_error_ci),
        number(summary.cost_of_transport, 2),
    )


def difference_table(results: Results) -> Table:
    """A row for each policy on each scenario: its difference from the baseline, with the corrected p-value below."""
    title = f"minus {results.baseline}, paired by episode\np corrected for their number (Holm)"
    table = console_table(title, "policy", *DIFFERENCES)
    rows: dict[str, dict[str, dict[str, str]]] = {}
    for comparison in results.against_baseline:
        by_policy = rows.setdefault(comparison.scenario, {})
        by_policy.setdefault(comparison.a, {})[comparison.metric] = _difference(comparison)
    for scenario, by_policy in rows.items():
        table.add_row(f"[bold]{escape(scenario)}[/bold]")
        for policy, cells in by_policy.items():
            table.add_row(f" {escape(policy)}", *(cells[metric] for metric in METRICS))
    return table


def print_spread(results: Results, console: Console) -> None:
    """A table for each training of several seeds, if there is one."""
    runs: dict[str, dict[str, dict[str, SeedSpread]]] = {}
    for spread in seed_spreads(results.cells):
        runs.setdefault(spread.run, {}).setdefault(spread.scenario, {})[spread.metric] = spread
    for run, scenarios in runs.items():
        count = next(iter(scenarios.values()))[SUCCESS_RATE].seeds
        title = f"{escape(run)}, {count} training seeds: mean ± standard deviation, lowest … highest"
        table = console_table(title, "scenario", *FIGURES)
        for scenario, metrics in scenarios.items():
            table.add_row(escape(scenario), *(_over_seeds(metrics[name]) for name in METRICS))
        console.print(table)
        console.print()


def _over_seeds(spread: SeedSpread) -> str:
    form = percent if spread.metric in RATES else number
    middle = f"{form(spread.mean)} ± {form(spread.standard_deviation)}"
    return f"{middle}\n{form(spread.lowest)} … {form(spread.highest)}"


def console_table(title: str, first: str = "policy", *others: str) -> Table:
    """An empty table in the style of all of them; columns but the first hold figures."""
    table = Table(
        title=title, title_justify="left", title_style="", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False
    )
    table.add_column(first, overflow="fold")
    for name in others:
        table.add_column(name, justify="right")
    return table


def _difference(comparison: Comparison) -> str:
    value = comparison.difference
    shown = points(value) if comparison.metric in RATES else number(value)
    return f"{shown}\n{p_value(comparison.p_value_holm)}"


def _spread(mean: float, ci: tuple[float, float]) -> str:
    return f"{number(mean)} ± {number((ci[1] - ci[0]) / 2)}"


def _shares(summary: Summary | None) -> str:
    """Successes, and in brackets falls, in per cent."""
    return f"{_percent(summary.success_rate)} ({_percent(summary.fall_rate)})" if summary else ""


def _percent(share: float) -> str:
    return number(100.0 * share, 0)
