"""Report section on motor effort: table of measures, and Pareto front with the hardware profile."""

from collections.abc import Iterator
from html import escape

from evaluate.analysis.results import Results
from evaluate.measures.catalogue import EFFORT
from evaluate.report.headings import EFFORT_SCENARIOS, EFFORT_TITLES, ROW_LABEL, estimate_effort
from evaluate.report.html import heading, note, section, table
from evaluate.report.sections.figures import policy_label, with_interval_below
from evaluate.report.sections.ranking import render_pareto_front

MOTION = (
    "Measured while upright; means over episodes with 95 % intervals. The cost of transport is computed from all "
    "episodes together."
)
"""Explanation that is printed below the table of effort measures."""


def render_effort(results: Results) -> str:
    """Render the section on motor effort as HTML; empty if it has neither a table nor a plot."""
    hardware_front = render_pareto_front(results, hardware=True) if not results.ranking.hardware else ""
    return section("Effort", *_figures(results), hardware_front)


def _figures(results: Results) -> Iterator[str]:
    """Yield the table of effort measures and its note as HTML.

    The table has a row for each policy on each scenario of the run that is in EFFORT_SCENARIOS. Nothing is yielded if
    the run has none of these scenarios.
    """
    rows = [
        _row(results, scenario, policy)
        for scenario in EFFORT_SCENARIOS
        for policy in results.policies
        if (scenario, policy) in results.summaries
    ]
    if rows:
        places = "; ".join(f"{name}: {words}" for name, words in EFFORT_SCENARIOS.items() if name in results.scenarios)
        yield table({ROW_LABEL: "policy", **{name: heading(*EFFORT_TITLES[name]) for name in EFFORT}}, rows)
        yield note(f"{places}. {MOTION}")


def _row(results: Results, scenario: str, policy: str) -> dict[str, str]:
    """Return the table row of a `policy` on a `scenario`: name of a column -> effort measure as HTML."""
    summary = results.summaries[scenario, policy]
    row = {ROW_LABEL: f"{policy_label(results, policy)}<small>{escape(scenario)}</small>"}
    for name in EFFORT:
        row[name] = with_interval_below(estimate_effort(name, summary.effort[name], summary.effort_intervals[name]))
    return row
