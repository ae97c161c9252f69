"""Tables of figures: what each policy did, and its paired differences."""

from collections.abc import Iterable
from html import escape

from evaluate.analysis.comparison import ERRORS, FALL_RATE, METRICS, RATES, SUCCESS_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, amount, place
from evaluate.analysis.summary import Summary
from evaluate.report.headings import DIFFERENCE_UNITS, FIRST, TITLES, UNITS
from evaluate.report.html import BEST, breakable, heading, mark, table
from evaluate.report.plots.drawing import MARKS, style
from quad_env.cli.format import ABSENT, interval, number, p_value, percent_interval, points, points_interval

HEADINGS = {metric: heading(TITLES[metric], UNITS[metric]) for metric in METRICS}
"""Metric -> its heading."""


def policy_label(results: Results, policy: str) -> str:
    """A policy's name with its mark."""
    colour, shape = style(results, policy)
    return f"{mark(colour, MARKS[shape])}{breakable(policy)}"


def summary_table(results: Results, scenario: str) -> str:
    """A row for each policy on one scenario."""
    rows = {policy: s for (name, policy), s in results.summaries.items() if name == scenario}
    best = {metric: min(getattr(summary, metric) for summary in rows.values()) for metric in ERRORS}
    heads = {FIRST: "policy", **HEADINGS, "cost_of_transport": "cost of transport", "diverged": "diverged"}
    body = ({FIRST: policy_label(results, policy), **_summary_cells(summary, best)} for policy, summary in rows.items())
    return table(heads, body)


def level_table(results: Results, axis: SeverityAxis) -> str:
    """Successes and falls in per cent: a policy a row, a level a column."""
    heads = {FIRST: heading("success (falls), %", f"at {escape(axis.unit or axis.name)}")}
    heads |= {level.name: amount(level.severity) for level in axis.levels}
    found = {
        policy: {level.name: results.summaries.get((level.name, policy)) for level in axis.levels}
        for policy in results.policies
    }
    rows = (
        {FIRST: policy_label(results, policy), **{name: _shares(s) if s else ABSENT for name, s in levels.items()}}
        for policy, levels in found.items()
        if any(levels.values())
    )
    return table(heads, rows, "levels")


def comparison_table(results: Results, comparisons: Iterable[Comparison]) -> str:
    """A row for each pair of policies on each scenario."""
    scenarios = {cell.scenario.name: cell.scenario for cell in results.cells}
    rows: dict[tuple[str, str, str], dict[str, str]] = {}
    for c in comparisons:
        rows.setdefault((c.scenario, c.a, c.b), {})[c.metric] = _difference(c)
    body = (
        {FIRST: f"{breakable(a)} − {breakable(b)}<small>{escape(place(scenarios[name]))}</small>", **cells}
        for (name, a, b), cells in rows.items()
    )
    return table({FIRST: "difference", **{m: heading(TITLES[m], DIFFERENCE_UNITS[m]) for m in METRICS}}, body)


def _summary_cells(summary: Summary, best: dict[str, float]) -> dict[str, str]:
    """Column -> cell."""
    cells = {"cost_of_transport": number(summary.cost_of_transport, 2), "diverged": str(summary.diverged)}
    for rate, count in ((SUCCESS_RATE, summary.successes), (FALL_RATE, summary.falls)):
        ci = percent_interval(getattr(summary, f"{rate}_ci"))
        cells[rate] = f"{count}&nbsp;of&nbsp;{summary.episodes}<small>{ci}</small>"
    for metric in ERRORS:
        value, ci = getattr(summary, metric), getattr(summary, f"{metric}_ci")
        text = f"{number(value)}<small>{interval(ci)}</small>"
        cells[metric] = f"{BEST}{text}" if value == best[metric] else text
    return cells


def _shares(summary: Summary) -> str:
    return f"{number(100.0 * summary.success_rate, 0)}&nbsp;({number(100.0 * summary.fall_rate, 0)})"


def _difference(comparison: Comparison) -> str:
    rate = comparison.metric in RATES
    value = points(comparison.difference) if rate else number(comparison.difference)
    ci = points_interval(comparison.ci) if rate else interval(comparison.ci)
    return f"{value}<small>{ci}</small><small>{escape(p_value(comparison.p_value_holm))}</small>"
