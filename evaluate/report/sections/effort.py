"""Effort next to success: the Pareto front, which policies dominate the others, and the figures of effort."""

from collections.abc import Iterator
from html import escape

from evaluate.analysis.pareto import Pareto
from evaluate.analysis.results import Results
from evaluate.measures.catalogue import EFFORT
from evaluate.report.headings import EFFORT_ON, EFFORT_TITLES, FIRST, effort_with_interval
from evaluate.report.html import breakable, grid, heading, image, note, section, table
from evaluate.report.plots import pareto as plots
from evaluate.report.plots.drawing import svg
from evaluate.report.sections.figures import policy_label

LEAD = (
    "A policy is on the Pareto front (filled marks, line) unless another has as much success at no higher cost and is "
    "better in one of them. Figures decide, not their 95 % intervals."
)
MOTION = "Over the time while upright; means over episodes with 95 % intervals, the cost of transport of all together."


def effort(results: Results) -> str:
    """Fronts and figures; empty where there is nothing to show."""
    fronts = [found for found in (results.pareto, results.hardware_pareto) if found.front]
    pictures = grid(image(svg(plots.front(found, results.policies)), plots.ALT) for found in fronts)
    said = "".join(f"<ul>{''.join(_lines(results, found))}</ul>" for found in fronts)
    return section("Effort", *([pictures, said, note(LEAD)] if fronts else ()), *_figures(results))


def _lines(results: Results, found: Pareto) -> Iterator[str]:
    """The front, and what dominates the others."""
    labels = {point.policy: policy_label(results, point.policy) for point in found.points}
    front = ", ".join(labels[policy] for policy in found.front)
    yield f"<li>On the Pareto front, cost of transport on {escape(found.cost_on or 'all scenarios')}: {front}</li>"
    for point in found.points:
        if point.dominated_by:
            yield f"<li>{labels[point.policy]} is dominated by {', '.join(map(breakable, point.dominated_by))}</li>"
        elif point.policy not in found.front:
            yield f"<li>{labels[point.policy]} goes nowhere: no cost of transport</li>"


def _figures(results: Results) -> Iterator[str]:
    """A row for each policy over the commands and at a steady speed."""
    rows = [
        {FIRST: f"{policy_label(results, policy)}<small>{escape(scenario)}</small>"}
        | {name: effort_with_interval(name, one, "<small>{}</small>") for name in EFFORT}
        for scenario in EFFORT_ON
        for policy in results.policies
        if (one := results.summaries.get((scenario, policy)))
    ]
    if rows:
        places = "; ".join(f"{name}: {words}" for name, words in EFFORT_ON.items() if name in results.scenarios)
        yield table({FIRST: "policy", **{name: heading(*EFFORT_TITLES[name]) for name in EFFORT}}, rows)
        yield note(f"{places}. {MOTION}")
