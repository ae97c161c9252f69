"""Tables of figures: what each policy did, and its paired differences."""

from collections.abc import Iterable, Iterator
from html import escape

from evaluate.analysis.comparison import ERRORS, FALL_RATE, RATES, SUCCESS_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, amount, place
from evaluate.analysis.summary import Summary
from evaluate.report.html import BEST, breakable, heading, mark, table
from evaluate.report.plots.drawing import MARKS, style
from evaluate.terminal.format import ABSENT, interval, number, p_value, percent_interval, points, points_interval

HEADINGS = {
    SUCCESS_RATE: ("success", ""),
    FALL_RATE: ("falls", ""),
    "velocity_error": ("velocity error", "m/s"),
    "mean_velocity_error": ("mean velocity error", "m/s"),
    "yaw_rate_error": ("yaw-rate error", "rad/s"),
}


def policy_label(results: Results, policy: str) -> str:
    """A policy's name with its mark."""
    colour, shape = style(results, policy)
    return f"{mark(colour, MARKS[shape])}{breakable(policy)}"


def summary_table(results: Results, scenario: str) -> str:
    """A row for each policy on one scenario."""
    rows = {policy: s for (name, policy), s in results.summaries.items() if name == scenario}
    best = {metric: min(getattr(summary, metric) for summary in rows.values()) for metric in ERRORS}
    heads = [*HEADINGS.values(), ("cost of transport", ""), ("diverged", "")]
    body = ([policy_label(results, policy), *_summary_cells(summary, best)] for policy, summary in rows.items())
    return table(["policy", *(heading(*head) for head in heads)], body)


def level_table(results: Results, axis: SeverityAxis) -> str:
    """Successes and falls in per cent: a policy a row, a level a column."""
    heads = [
        heading("success (falls), %", f"at {escape(axis.unit or axis.name)}"),
        *(amount(level.severity) for level in axis.levels),
    ]
    found = {
        policy: [results.summaries.get((level.name, policy)) for level in axis.levels] for policy in results.policies
    }
    rows = (
        [policy_label(results, policy), *(_shares(s) if s else ABSENT for s in levels)]
        for policy, levels in found.items()
        if any(levels)
    )
    return table(heads, rows, "levels")


def comparison_table(results: Results, comparisons: Iterable[Comparison]) -> str:
    """A row for each pair of policies on each scenario."""
    scenarios = {cell.scenario.name: cell.scenario for cell in results.cells}
    rows: dict[tuple[str, str, str], dict[str, str]] = {}
    for c in comparisons:
        rows.setdefault((c.scenario, c.a, c.b), {})[c.metric] = _difference(c)
    body = (
        [f"{breakable(a)} − {breakable(b)}<small>{escape(place(scenarios[name]))}</small>"]
        + [cells[metric] for metric in HEADINGS]
        for (name, a, b), cells in rows.items()
    )
    units = HEADINGS | {SUCCESS_RATE: ("success", "% points"), FALL_RATE: ("falls", "% points")}
    return table(["difference", *(heading(*head) for head in units.values())], body)


def _summary_cells(summary: Summary, best: dict[str, float]) -> Iterator[str]:
    for count, ci in ((summary.successes, summary.success_rate_ci), (summary.falls, summary.fall_rate_ci)):
        yield f"{count}&nbsp;of&nbsp;{summary.episodes}<small>{percent_interval(ci)}</small>"
    for metric in ERRORS:
        value, ci = getattr(summary, metric), getattr(summary, f"{metric}_ci")
        text = f"{number(value)}<small>{interval(ci)}</small>"
        yield f"{BEST}{text}" if value == best[metric] else text
    yield number(summary.cost_of_transport, 2)
    yield str(summary.diverged)


def _shares(summary: Summary) -> str:
    return f"{number(100.0 * summary.success_rate, 0)}&nbsp;({number(100.0 * summary.fall_rate, 0)})"


def _difference(comparison: Comparison) -> str:
    rate = comparison.metric in RATES
    value = points(comparison.difference) if rate else number(comparison.difference)
    ci = points_interval(comparison.ci) if rate else interval(comparison.ci)
    return f"{value}<small>{ci}</small><small>{escape(p_value(comparison.p_value_holm))}</small>"
