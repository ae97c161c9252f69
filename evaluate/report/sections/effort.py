"""The figures of effort, and the Pareto front with the hardware profile."""

from collections.abc import Iterator
from html import escape

from evaluate.analysis.results import Results
from evaluate.measures.catalogue import EFFORT
from evaluate.report.headings import EFFORT_ON, EFFORT_TITLES, FIRST, effort_with
from evaluate.report.html import heading, note, section, table
from evaluate.report.sections.figures import policy_label, with_interval_below
from evaluate.report.sections.ranking import front

MOTION = "Over the time while upright; means over episodes with 95 % intervals, the cost of transport of all together."


def effort(results: Results) -> str:
    """Figures, and with the hardware profile the front; empty where there is nothing to show."""
    real = front(results, hardware=True) if not results.ranking.hardware else ""
    return section("Effort", *_figures(results), real)


def _figures(results: Results) -> Iterator[str]:
    """A row for each policy over the commands and at a steady speed."""
    rows = [
        {FIRST: f"{policy_label(results, policy)}<small>{escape(scenario)}</small>"}
        | {name: with_interval_below(effort_with(name, one.effort[name], ends[name])) for name in EFFORT}
        for scenario in EFFORT_ON
        for policy in results.policies
        if (one := results.summaries.get((scenario, policy)))
        for ends in [one.effort_intervals]
    ]
    if rows:
        places = "; ".join(f"{name}: {words}" for name, words in EFFORT_ON.items() if name in results.scenarios)
        yield table({FIRST: "policy", **{name: heading(*EFFORT_TITLES[name]) for name in EFFORT}}, rows)
        yield note(f"{places}. {MOTION}")
