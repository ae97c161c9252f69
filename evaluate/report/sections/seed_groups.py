"""Section of the report with the groups of training seeds: one row for each group."""

from evaluate.analysis.results import Results
from evaluate.analysis.score import SCORES
from evaluate.report.headings import ROW_LABEL
from evaluate.report.html import breakable, heading, note, section, table
from evaluate.report.sections.figures import with_interval_below
from quad_env.cli.format import estimate, points_with, with_count

NOTE = (
    "Mean and interquartile mean over the policies that one algorithm has trained with several seeds. The 95 % "
    "intervals are over seeds and episodes: a bootstrap stratified by scenario (rliable; Agarwal et al. 2021), "
    "widened to Student's t; for two seeds or one scenario, Wilson's interval with the effective number of trials."
)
"""Explanation of the figures of the groups of training seeds, below their table."""


def render_seed_groups(results: Results) -> str:
    """Render the table of the groups of training seeds as HTML; empty if the run has no groups."""
    if not results.groups:
        return ""
    heads = {ROW_LABEL: "training"}
    for name in SCORES:
        heads |= {name: heading(name, "%"), f"{name} iqm": heading(f"{name}, interquartile mean", "%")}
    heads["cost"] = "cost of transport"
    rows = []
    for group in results.groups:
        seeds = with_count(len(group.policies), "seed")
        cells = dict.fromkeys(heads, "") | {ROW_LABEL: heading(breakable(group.name), seeds)}
        for name, score in zip(SCORES, (group.score, group.hardware_score), strict=True):
            if score is not None:
                cells[name] = with_interval_below(points_with(score.score, score.ci))
                middle = points_with(score.interquartile_mean, score.interquartile_mean_ci)
                cells[f"{name} iqm"] = with_interval_below(middle)
        cost = estimate(group.cost_of_transport, group.cost_of_transport_ci, 2)
        rows.append(cells | {"cost": with_interval_below(cost)})
    known = {name: head for name, head in heads.items() if any(row[name] for row in rows)}
    return section("Training seeds", table(known, rows), note(NOTE))
