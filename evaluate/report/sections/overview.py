"""The first pictures and tables of the page: success and scores, and breaking points."""

from collections.abc import Mapping
from html import escape

from evaluate.analysis.breaking_points import CAVEAT, HALF, AxisBreakingPoint, Of, figure_and_interval
from evaluate.analysis.results import Results
from evaluate.analysis.score import WORDS, Score
from evaluate.analysis.severity_levels import severity_axes
from evaluate.report.headings import FIRST
from evaluate.report.html import grid, heading, image, note, section, table, wide
from evaluate.report.plots import success as success_plots
from evaluate.report.plots.drawing import svg
from evaluate.report.sections.axis_section import anchor
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import ABSENT, NO_BREAK, number, p_value, percent_interval, points, points_interval

SUCCESS_LEAD = (
    "Episodes that succeed, in %: in each block the severities of an axis in this run, the mildest to the left. An "
    "episode succeeds if the robot stays upright and tracks its command within tolerance in every interval."
)
BREAKING_LEAD = (
    "Severities at which half of the episodes no longer succeed, and fall, with their 95 % intervals. "
    f"{CAVEAT} “None up to” is the hardest level tried; “already at” the mildest."
)


def success(results: Results) -> str:
    """Scores, heat map and outcomes; outcomes alone of a run of one axis."""
    outcomes = image(svg(success_plots.outcomes(results)), "What came of the episodes of each policy")
    if not results.scores:
        return section("Success", grid([outcomes]))
    heat_map = image(
        svg(success_plots.heat_map(results.scores)), "Success of each policy on each axis at each severity, in per cent"
    )
    minus = heading(f"minus {escape(results.baseline)}", "% points")
    heads = {"policy": "policy", "score": heading("score", "%"), "difference": minus}
    rows = (
        {"policy": policy_label(results, each.policy), **_score_cells(each, results.baseline)}
        for each in results.scores
    )
    pictures = note(SUCCESS_LEAD), wide(heat_map), grid([outcomes])
    return section("Success", table(heads, rows), note(WORDS), *pictures)


def _score_cells(score: Score, baseline: str) -> dict[str, str]:
    """Column -> cell."""
    figure = f"{number(100.0 * score.score, 1)}<small>{percent_interval(score.ci)}</small>"
    ci = f"<small>{points_interval(score.difference_ci)}</small><small>{escape(p_value(score.p_value))}</small>"
    return {"score": figure, "difference": f"{points(score.difference)}{ci}" if score.policy != baseline else ""}


def overview(results: Results) -> str:
    """Breaking points, an axis a row; empty where no axis has levels enough."""
    found = {point.axis for point in results.breaking_points}
    axes = {axis.name: axis.quantity for axis in severity_axes(results.cells) if axis.name in found}
    tables = (_breaking_points(results, axes, of) for of in HALF)
    return section("Breaking points", note(BREAKING_LEAD), *tables) if axes else ""


def _breaking_points(results: Results, axes: Mapping[str, str], of: Of) -> str:
    """A table, headed by what breaks, of the policies that have a breaking point."""
    cells = {(point.axis, point.policy): _breaking_cell(point) for point in results.breaking_points if point.of == of}
    policies = {name: policy_label(results, name) for name in results.policies if any(name == one for _, one in cells)}
    rows = [
        {FIRST: f'<a href="#{anchor(axis)}">{escape(axis)}</a><small>{escape(words)}</small>'}
        | {policy: cells.get((axis, policy), ABSENT) for policy in policies}
        for axis, words in axes.items()
    ]
    return f"<h3>{HALF[of].capitalize()}</h3>{table({FIRST: 'axis', **policies}, rows, 'text')}" if cells else ""


def _breaking_cell(point: AxisBreakingPoint) -> str:
    figure, ends = figure_and_interval(point)
    return f"{escape(figure)}<small>{escape(ends.replace(NO_BREAK, ' '))}</small>" if ends else escape(figure)
