"""First sections of the report: ranking, Pareto front, best and worst disturbances of each policy."""

from html import escape

from evaluate.analysis.results import Results
from evaluate.analysis.score import SCORES
from evaluate.report import verdict
from evaluate.report.headings import ROW_LABEL
from evaluate.report.html import breakable, grid, heading, image, note, section, table
from evaluate.report.plots import pareto as plots
from evaluate.report.plots.drawing import figure_to_svg
from evaluate.report.sections.figures import policy_label, with_interval_below
from evaluate.report.verdict import adjacent_pair_lines, unranked_text
from quad_env.cli.format import estimate, join_names, points_with


def render_ranking(results: Results) -> str:
    """Render the ranking as HTML: scores, Pareto front, and the test result of each adjacent pair."""
    ranked = results.ranking
    items = [
        f'<li class="{"better" if pair.distinguished else "alike"}">{breakable(line)}</li>'
        for pair, line in zip(ranked.neighbours, adjacent_pair_lines(ranked), strict=True)
    ]
    tables = grid((_table(results), render_pareto_front(results, hardware=ranked.hardware)))
    return section("Ranking", tables, f'<ul class="verdicts">{"".join(items)}</ul>', note(_lead(results)))


def _lead(results: Results) -> str:
    """Return the note below the ranking: the definition of the score, and the policies that have no rank."""
    axes = results.ranking.axes
    score = f"Score: mean success over {axes} axes, each axis and each of its severities alike. " if axes > 1 else ""
    unranked = unranked_text(results)
    last = f" {unranked[0].upper()}{unranked[1:]}." if unranked else ""
    return f"{score}95 % intervals; differences paired by episode; all claims are corrected together.{last}"


def render_pareto_front(results: Results, *, hardware: bool) -> str:
    """Render the plot of success against cost of transport, with a caption.

    Args:
        results: Results of the run.
        hardware: True for the scenarios with the hardware profile, False for the scenarios without it.

    Returns:
        HTML of the plot; empty if no policy has a cost of transport.
    """
    pareto = results.hardware_pareto if hardware else results.pareto
    if not pareto.front:
        return ""
    cost = f"cost of transport on {pareto.cost_on or 'all scenarios'}"
    caption = f"{cost.capitalize()}. On the Pareto front (filled marks, line): {join_names(pareto.front)}."
    svg = figure_to_svg(plots.draw_pareto_front(pareto, results.policies))
    return f"<div>{image(svg, plots.ALT)}{note(caption)}</div>"


def _table(results: Results) -> str:
    """Create the HTML table of scores, with a row for each policy.

    The columns are the scores without and with the hardware profile, and the cost of transport.
    """
    names = SCORES if results.ranking.axes > 1 else ("success", "success, hardware profile")
    points_by_name = {
        name: pareto.points
        for name, pareto in zip(names, (results.pareto, results.hardware_pareto), strict=True)
        if pareto.points
    }
    rows: dict[str, dict[str, str]] = {}
    for name, points in points_by_name.items():
        for point in points:
            row = rows.setdefault(point.policy, {})
            row[name] = with_interval_below(points_with(point.success, point.success_ci))
            row.setdefault("cost", with_interval_below(estimate(point.cost, point.cost_ci, 2)))
    heads = {ROW_LABEL: "policy", **{name: heading(name, "%") for name in points_by_name}, "cost": "cost of transport"}
    empty_row = dict.fromkeys(heads, "")
    return table(heads, (empty_row | row | {ROW_LABEL: policy_label(results, policy)} for policy, row in rows.items()))


def render_best_and_worst(results: Results) -> str:
    """Render the table of the disturbance axes on which each policy is best and worst, as HTML.

    The table also contains the most common cause of failure on each of the worst axes.
    """
    heads = {ROW_LABEL: "policy", "best": "best on", "worst": "worst on"}
    rows = (
        {ROW_LABEL: policy_label(results, policy), "best": escape(best), "worst": escape(worst)}
        for policy, (best, worst) in verdict.best_and_worst(results).items()
    )
    return section("Best and worst", table(heads, rows, "text"))
