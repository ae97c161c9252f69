"""Effort next to success: the Pareto front, which policies dominate the others, and the figures of effort."""

from collections.abc import Iterator
from html import escape

from evaluate.analysis.pareto import Pareto, ParetoPoint
from evaluate.analysis.results import Results
from evaluate.measures.catalogue import EFFORT
from evaluate.report.headings import EFFORT_ON, EFFORT_TITLES, FIRST, figure_of_effort, interval_of_effort
from evaluate.report.html import breakable, grid, heading, image, note, section, table
from evaluate.report.plots import pareto as plots
from evaluate.report.plots.drawing import svg
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import ABSENT, number, percent_interval

LEAD = (
    "A policy is on the Pareto front (filled marks, line) unless another has as much success at no higher cost and is "
    "better in one of them. Figures decide, not their intervals; a policy that goes nowhere has no cost of transport."
)
MOTION = "Over the time while upright; means over episodes with 95 % intervals, the cost of transport of all together."


def effort(results: Results) -> str:
    """Figures and tables; empty where there is nothing to show."""
    fronts = [found for found in (results.pareto, results.hardware_pareto) if found.front]
    words = "Success against cost of transport of each policy on "
    pictures = [image(svg(plots.front(each, results.policies)), f"{words}{_place(each)}") for each in fronts]
    tables = [_front(results, each) for each in fronts]
    return section("Effort", *([grid(pictures), *tables, note(LEAD)] if fronts else ()), *_figures(results))


def _place(found: Pareto) -> str:
    return found.cost_on or "all scenarios"


def _front(results: Results, found: Pareto) -> str:
    cost = heading("cost of transport", escape(_place(found)))
    heads = {FIRST: "policy", "success": heading("success", "%"), "cost": cost, "front": "Pareto front"}
    rows = (
        {
            FIRST: policy_label(results, point.policy),
            "success": f"{number(100.0 * point.success, 1)}<small>{percent_interval(point.success_ci)}</small>",
            "cost": _cell("cost_of_transport", point.cost, point.cost_ci),
            "front": "on it" if point.policy in found.front else _dominated(point),
        }
        for point in found.points
    )
    return table(heads, rows)


def _dominated(point: ParetoPoint) -> str:
    return f"dominated by {', '.join(map(breakable, point.dominated_by))}" if point.dominated_by else ABSENT


def _figures(results: Results) -> Iterator[str]:
    """A row for each policy over the commands and at a steady speed."""
    rows = [
        {FIRST: f"{policy_label(results, policy)}<small>{escape(scenario)}</small>"}
        | {name: _cell(name, one.effort[name], one.effort_intervals[name]) for name in EFFORT}
        for scenario in EFFORT_ON
        for policy in results.policies
        if (one := results.summaries.get((scenario, policy)))
    ]
    if rows:
        places = "; ".join(f"{name}: {words}" for name, words in EFFORT_ON.items() if name in results.scenarios)
        yield table({FIRST: "policy", **{name: heading(*EFFORT_TITLES[name]) for name in EFFORT}}, rows)
        yield note(f"{places}. {MOTION}")


def _cell(name: str, value: float, ends: tuple[float, float]) -> str:
    below = interval_of_effort(name, ends)
    return figure_of_effort(name, value) + (f"<small>{below}</small>" if below else "")
