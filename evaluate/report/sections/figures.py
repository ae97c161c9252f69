"""Tables of figures: success, paired differences of it, and every measure."""

import math
from collections.abc import Iterable
from html import escape

from evaluate.analysis.comparison import RATES, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.summary import Summary
from evaluate.measures.catalogue import BY_NAME, FIGURES, KEY, MEASURES
from evaluate.report.headings import FIRST, TITLES
from evaluate.report.html import breakable, heading, mark, note, table
from evaluate.report.plots.drawing import MARKS, style
from evaluate.report.verdict import claim
from quad_env.cli.format import ABSENT, Estimate, four_digits, points_with, share

UNKNOWN = math.nan, math.nan
"""Interval of a figure without one."""


def policy_label(results: Results, policy: str) -> str:
    """A policy's name with its mark."""
    colour, shape = style(results, policy)
    return f"{mark(colour, MARKS[shape])}{breakable(policy)}"


def comparison_table(comparisons: Iterable[Comparison]) -> str:
    """Differences of success: a row for each pair of policies on each scenario."""
    heads = {FIRST: "difference", "success": heading("success", "% points"), "p": "p"}
    rows = (
        {
            FIRST: f"{breakable(c.a)} − {breakable(c.b)}<small>{escape(c.scenario)}</small>",
            "success": with_interval_below(points_with(c.difference, c.ci)),
            "p": claim(c.p_value_holm, c.ci, identical=c.identical),
        }
        for c in comparisons
    )
    return table(heads, rows)


def figures_table(results: Results, scenario: str) -> str:
    """Every measure of the catalogue: a measure a row, a policy a column."""
    found = {policy: summary for (name, policy), summary in results.summaries.items() if name == scenario}
    rows = [
        {FIRST: TITLES[rate]}
        | {policy: share(getattr(of, rate), getattr(of, f"{rate}_ci")) for policy, of in found.items()}
        for rate in RATES
    ]
    rows += [
        {FIRST: heading(escape(BY_NAME[name].title), escape(BY_NAME[name].unit))}
        | {policy: _figure(of, name) for policy, of in found.items()}
        for name in FIGURES
        if any(of.figures[name] == of.figures[name] for of in found.values())
    ]
    rows += [
        {FIRST: f"duty factor, {leg}"}
        | {policy: four_digits(of.duty_factor[foot], UNKNOWN).value for policy, of in found.items()}
        for foot, leg in enumerate(results.hardware.robot_model.leg_names)
    ]
    return table({FIRST: "measure", **{policy: policy_label(results, policy) for policy in found}}, rows)


def _figure(of: Summary, name: str) -> str:
    """With its interval, where it has one."""
    ends = getattr(of, f"{name}_ci", of.effort_intervals.get(name, UNKNOWN))
    return with_interval_below(four_digits(of.figures[name], ends))


def with_interval_below(shown: Estimate) -> str:
    """Format a figure, with its interval, if any, in small type."""
    return shown.value + (f"<small>{shown.interval}</small>" if shown.has_interval else "")


def definitions() -> str:
    """The table of measures."""
    rows = [
        {
            "measure": f"{escape(m.title)}<small>{m.name}</small>",
            "unit": escape(m.unit) or ABSENT,
            "frame": escape(m.frame) or ABSENT,
            "formula": escape(m.formula),
            "source": escape(m.source) or "this project",
            "over": m.scope,
        }
        for m in MEASURES
    ]
    return note(KEY) + table({column: column for column in rows[0]}, rows, "text")
