"""Tables of figures: what each policy did, its paired differences, and every measure."""

from collections.abc import Iterable
from html import escape

from evaluate.analysis.comparison import ERRORS, FALL_RATE, METRICS, RATES, SUCCESS_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, amount, place
from evaluate.analysis.summary import Summary
from evaluate.measures import catalogue
from evaluate.measures.catalogue import BY_NAME, FIGURES, KEY, MEASURES
from evaluate.measures.outcomes import RULES
from evaluate.report.headings import DIFFERENCE_UNITS, FIRST, TITLES, UNITS, shares
from evaluate.report.html import BEST, breakable, heading, mark, note, table
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
        {FIRST: policy_label(results, policy), **{name: shares(s) if s else ABSENT for name, s in levels.items()}}
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


def _difference(comparison: Comparison) -> str:
    rate = comparison.metric in RATES
    value = points(comparison.difference) if rate else number(comparison.difference)
    ci = points_interval(comparison.ci) if rate else interval(comparison.ci)
    claim = f"<small>{p_value(comparison.p_value_holm)}</small>" if comparison.metric == SUCCESS_RATE else ""
    return f"{value}<small>{ci}</small>{claim}"


def figures_table(results: Results, scenario: str) -> str:
    """Every measure of the catalogue: a measure a row, a policy a column."""
    found = {policy: summary for (name, policy), summary in results.summaries.items() if name == scenario}
    rows = [
        {FIRST: heading(escape(BY_NAME[name].title), escape(BY_NAME[name].unit))}
        | {policy: _four_digits(summary.figures[name]) for policy, summary in found.items()}
        for name in FIGURES
        if any(summary.figures[name] == summary.figures[name] for summary in found.values())
    ]
    rows += [
        {FIRST: f"duty factor, {leg}"}
        | {policy: _four_digits(summary.duty_factor[foot]) for policy, summary in found.items()}
        for foot, leg in enumerate(results.hardware.quadruped.leg_names)
    ]
    return table({FIRST: "measure", **{policy: policy_label(results, policy) for policy in found}}, rows)


def definitions(success_rule: str) -> str:
    """The table of measures, the outcome by that rule."""
    rows = [
        {
            "measure": f"{escape(m.title)}<small>{m.name}</small>",
            "unit": escape(m.unit) or ABSENT,
            "frame": escape(m.frame) or ABSENT,
            "formula": escape(m.formula),
            "source": escape(m.source) or "this project",
            "over": m.scope,
        }
        for m in (catalogue.outcome(RULES[success_rule]), *MEASURES[1:])
    ]
    return note(KEY) + table({column: column for column in rows[0]}, rows, "text")


def _four_digits(value: float) -> str:
    """Four significant digits."""
    return f"{value:.4g}" if abs(value) < float("inf") else ABSENT
