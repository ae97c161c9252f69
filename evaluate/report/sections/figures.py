"""Tables of figures: success, paired differences of success, and every measure."""

import math
from collections.abc import Iterable
from html import escape

from evaluate.analysis.comparison import RATES, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.summary import Summary
from evaluate.measures.catalogue import FIGURES, KEY, MEASURES
from evaluate.measures.extra import definition, extra_measures
from evaluate.report.headings import ROW_LABEL, TITLES
from evaluate.report.html import breakable, heading, mark, note, table
from evaluate.report.plots.drawing import MARKS, style
from evaluate.report.verdict import claim_text
from quad_env.cli.format import ABSENT, Estimate, four_digits, points_with, share

UNKNOWN = math.nan, math.nan
"""Interval of a figure without one."""


def policy_label(results: Results, policy: str) -> str:
    """Return the name of a `policy` with its mark in the plots of the `results`."""
    colour, shape = style(results, policy)
    return f"{mark(colour, MARKS[shape])}{breakable(policy)}"


def comparison_table(comparisons: Iterable[Comparison]) -> str:
    """Create the table of differences of success: a row for each pair of policies on each scenario."""
    heads = {ROW_LABEL: "difference", "success": heading("success", "% points"), "p": "p"}
    rows = (
        {
            ROW_LABEL: f"{breakable(c.a)} − {breakable(c.b)}<small>{escape(c.scenario)}</small>",
            "success": with_interval_below(points_with(c.difference, c.ci)),
            "p": claim_text(c.p_value_holm, c.ci, identical=c.identical),
        }
        for c in comparisons
    )
    return table(heads, rows)


def figures_table(results: Results, scenario: str) -> str:
    """Create the table of all measures of the `results` on a `scenario`, one column per policy."""
    found = {policy: summary for (name, policy), summary in results.summaries.items() if name == scenario}
    rows = [
        {ROW_LABEL: TITLES[rate]}
        | {policy: share(getattr(of, rate), getattr(of, f"{rate}_ci")) for policy, of in found.items()}
        for rate in RATES
    ]
    rows += [
        {ROW_LABEL: heading(escape(definition(name).title), escape(definition(name).unit))}
        | {policy: _figure(of, name) for policy, of in found.items()}
        for name in (*FIGURES, *_extra_names(found.values()))
        if any(not math.isnan(of.figures.get(name, math.nan)) for of in found.values())
    ]
    rows += [
        {ROW_LABEL: f"duty factor, {leg}"}
        | {policy: four_digits(of.duty_factor[foot], UNKNOWN).value for policy, of in found.items()}
        for foot, leg in enumerate(results.hardware.robot_model.leg_names)
    ]
    return table({ROW_LABEL: "measure", **{policy: policy_label(results, policy) for policy in found}}, rows)


def _extra_names(summaries: Iterable[Summary]) -> list[str]:
    """Return the names of the measures of extensions, in order."""
    return [*dict.fromkeys(name for summary in summaries for name in summary.figures if name not in FIGURES)]


def _figure(of: Summary, name: str) -> str:
    """Format a figure with its interval, if any."""
    ends = getattr(of, f"{name}_ci", of.effort_intervals.get(name, UNKNOWN))
    return with_interval_below(four_digits(of.figures.get(name, math.nan), ends))


def with_interval_below(shown: Estimate) -> str:
    """Format a figure, with its interval, if any, in small type."""
    return shown.value + (f"<small>{shown.interval}</small>" if shown.has_interval else "")


def measure_definitions() -> str:
    """Create the table of all measures with unit, frame, formula and source."""
    rows = [
        {
            "measure": f"{escape(m.title)}<small>{m.name}</small>",
            "unit": escape(m.unit) or ABSENT,
            "frame": escape(m.frame) or ABSENT,
            "formula": escape(m.formula),
            "source": escape(m.source) or "this project",
            "over": m.scope,
        }
        for m in (*MEASURES, *map(definition, extra_measures()))
    ]
    return note(KEY) + table({column: column for column in rows[0]}, rows, "text")
