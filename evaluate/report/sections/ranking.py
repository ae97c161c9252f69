"""First sections of the page: ranking with Pareto front, and the best and worst axes of each policy."""

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
    """Render scores, the result for each adjacent pair, and success against cost of transport."""
    said = zip(results.ranking.neighbours, adjacent_pair_lines(results.ranking), strict=True)
    items = (f'<li class="{"better" if each.distinguished else "alike"}">{breakable(line)}</li>' for each, line in said)
    pair = grid((_table(results), render_pareto_front(results, hardware=results.ranking.hardware)))
    return section("Ranking", pair, f'<ul class="verdicts">{"".join(items)}</ul>', note(_lead(results)))


def _lead(results: Results) -> str:
    """Return the note on the figures, and on policies without a place."""
    axes = results.ranking.axes
    score = f"Score: mean success over {axes} axes, each axis and each of its severities alike. " * (axes > 1)
    out = f" {said[0].upper()}{said[1:]}." if (said := unranked_text(results)) else ""
    return f"{score}95 % intervals; differences paired by episode; all claims are corrected together.{out}"


def render_pareto_front(results: Results, *, hardware: bool) -> str:
    """Render success against cost of transport.

    Args:
        results: Results of the run.
        hardware: Whether to show the figures with the hardware profile.

    Returns:
        HTML; empty if no policy moves.
    """
    found = results.hardware_pareto if hardware else results.pareto
    if not found.front:
        return ""
    on = f"cost of transport on {found.cost_on or 'all scenarios'}"
    caption = f"{on.capitalize()}. On the Pareto front (filled marks, line): {join_names(found.front)}."
    return (
        f"<div>{image(figure_to_svg(plots.draw_pareto_front(found, results.policies)), plots.ALT)}{note(caption)}</div>"
    )


def _table(results: Results) -> str:
    """Create the table of scores: a row per policy, with the hardware profile on the right."""
    names = SCORES if results.ranking.axes > 1 else ("success", "success, hardware profile")
    kinds = {name: of.points for name, of in zip(names, (results.pareto, results.hardware_pareto), strict=True)}
    kinds = {name: points for name, points in kinds.items() if points}
    rows: dict[str, dict[str, str]] = {}
    for name, points in kinds.items():
        for each in points:
            row = rows.setdefault(each.policy, {})
            row[name] = with_interval_below(points_with(each.success, each.success_ci))
            row.setdefault("cost", with_interval_below(estimate(each.cost, each.cost_ci, 2)))
    heads = {ROW_LABEL: "policy", **{name: heading(name, "%") for name in kinds}, "cost": "cost of transport"}
    blank = dict.fromkeys(heads, "")
    return table(heads, (blank | row | {ROW_LABEL: policy_label(results, policy)} for policy, row in rows.items()))


def render_best_and_worst(results: Results) -> str:
    """Render the axes on which each policy is best and worst, with the most common cause of failure there."""
    heads = {ROW_LABEL: "policy", "best": "best on", "worst": "worst on"}
    rows = (
        {ROW_LABEL: policy_label(results, policy), "best": escape(best), "worst": escape(worst)}
        for policy, (best, worst) in verdict.best_and_worst(results).items()
    )
    return section("Best and worst", table(heads, rows, "text"))
