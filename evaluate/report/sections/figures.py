"""HTML tables of the report: paired differences in success, all measures, and their definitions."""

import math
from collections.abc import Iterable, Mapping
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
"""Lower and upper end of the confidence interval of a value for which no interval is computed."""


def policy_label(results: Results, policy: str) -> str:
    """Return the label of a `policy` as HTML: its mark in the plots of the `results`, and its name."""
    colour, shape = style(results, policy)
    return f"{mark(colour, MARKS[shape])}{breakable(policy)}"


def comparison_table(comparisons: Iterable[Comparison]) -> str:
    """Create the HTML table of differences in success: a row for each pair of policies on each scenario."""
    heads = {ROW_LABEL: "difference", "success": heading("success", "% points"), "p": "p"}
    return table(heads, map(_comparison_row, comparisons))


def _comparison_row(comparison: Comparison) -> dict[str, str]:
    """Return the table row of one comparison of success: name of a column -> contents of the cell as HTML."""
    pair = f"{breakable(comparison.a)} − {breakable(comparison.b)}"
    return {
        ROW_LABEL: f"{pair}<small>{escape(comparison.scenario)}</small>",
        "success": with_interval_below(points_with(comparison.difference, comparison.ci)),
        "p": claim_text(comparison.p_value_holm, comparison.ci, identical=comparison.identical),
    }


def figures_table(results: Results, scenario: str) -> str:
    """Create the table of all measures on a scenario: a row for each measure, a column for each policy.

    Args:
        results: Results of the evaluation.
        scenario: Name of the scenario.

    Returns:
        The table as HTML.
    """
    summaries = {policy: summary for (name, policy), summary in results.summaries.items() if name == scenario}
    rows = [{ROW_LABEL: TITLES[rate]} | _rate_cells(summaries, rate) for rate in RATES]
    for name in (*FIGURES, *_extra_names(summaries.values())):
        if any(not math.isnan(summary.figures.get(name, math.nan)) for summary in summaries.values()):
            label = heading(escape(definition(name).title), escape(definition(name).unit))
            rows.append({ROW_LABEL: label} | {policy: _figure(summary, name) for policy, summary in summaries.items()})
    for foot, leg in enumerate(results.hardware.robot_model.leg_names):
        cells = {policy: four_digits(summary.duty_factor[foot], UNKNOWN).value for policy, summary in summaries.items()}
        rows.append({ROW_LABEL: f"duty factor, {leg}"} | cells)
    return table({ROW_LABEL: "measure", **{policy: policy_label(results, policy) for policy in summaries}}, rows)


def _rate_cells(summaries: Mapping[str, Summary], rate: str) -> dict[str, str]:
    """Return the table row of a `rate`: policy -> text of its success or fall rate with interval."""
    return {
        policy: share(getattr(summary, rate), getattr(summary, f"{rate}_ci")) for policy, summary in summaries.items()
    }


def _extra_names(summaries: Iterable[Summary]) -> list[str]:
    """Return the names of all measures of extensions in the `summaries`, in the order of occurrence."""
    return [*dict.fromkeys(name for summary in summaries for name in summary.figures if name not in FIGURES)]


def _figure(summary: Summary, name: str) -> str:
    """Format the measure `name` of a policy on a scenario as HTML, with its interval if it has one."""
    ends = getattr(summary, f"{name}_ci", summary.effort_intervals.get(name, UNKNOWN))
    return with_interval_below(four_digits(summary.figures.get(name, math.nan), ends))


def with_interval_below(figure: Estimate) -> str:
    """Format the value `figure` as HTML; its interval, if it has one, is below in small type."""
    return figure.value + (f"<small>{figure.interval}</small>" if figure.has_interval else "")


def measure_definitions() -> str:
    """Create the HTML table that defines all measures: unit, frame, formula and source."""
    rows = [
        {
            "measure": f"{escape(measure.title)}<small>{measure.name}</small>",
            "unit": escape(measure.unit) or ABSENT,
            "frame": escape(measure.frame) or ABSENT,
            "formula": escape(measure.formula),
            "source": escape(measure.source) or "this project",
            "over": measure.scope,
        }
        for measure in (*MEASURES, *map(definition, extra_measures()))
    ]
    return note(KEY) + table({column: column for column in rows[0]}, rows, "text")
