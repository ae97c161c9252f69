"""Report sections on all disturbance axes: heat map of success, and table of breaking points.

A breaking point is the severity at which half of the episodes no longer succeed.
"""

from html import escape

from evaluate.analysis.breaking_points import breaking_point_text
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import severity_axes
from evaluate.report.headings import ROW_LABEL
from evaluate.report.html import image, note, section, table, wide
from evaluate.report.plots import success
from evaluate.report.plots.drawing import figure_to_svg
from evaluate.report.sections.axis_section import anchor
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import ABSENT

SUCCESS_LEAD = (
    "Success rate, %: each block has the severities of an axis in this run, the mildest on the left. An episode "
    "succeeds if the robot stays upright and tracks its command within tolerance in every interval. Apart on the "
    "right: with the robot's hardware profile."
)
"""Explanation that is printed above the heat map of success."""
BREAKING_LEAD = (
    "Severities at which half of the episodes no longer succeed, with 95 % intervals: from the last level that "
    "significantly fewer than half of the episodes fail to the first level that significantly more fail. More levels "
    "near it make the interval narrower. “None up to” names the hardest level of the run, “already at” the mildest."
)
"""Explanation that is printed above the table of breaking points."""


def render_overview(results: Results) -> str:
    """Render heat map of success and breaking points as HTML; a part is left out if it has no data."""
    return f"{_heat_map(results)}{_breaking_points(results)}"


def _heat_map(results: Results) -> str:
    """Render the heat map of success as HTML; empty if the run has only one disturbance axis."""
    scores = (*results.scores, *results.hardware_scores)
    if all(len(score.axes) < 2 for score in scores):
        return ""
    svg = figure_to_svg(success.draw_heat_map(results.scores, results.hardware_scores))
    heat_map = image(svg, "Success of each policy on each axis at each severity, in per cent")
    return section("Success on every axis", note(SUCCESS_LEAD), wide(heat_map))


def _breaking_points(results: Results) -> str:
    """Render the table of breaking points of success as HTML; empty if the run has no breaking points."""
    points = [point for point in results.breaking_points if point.of == "success"]
    cells = {(point.axis, point.policy): escape(breaking_point_text(point)) for point in points}
    axes = {axis for axis, _ in cells}
    policies_with_points = {policy for _, policy in cells}
    policies = {name: policy_label(results, name) for name in results.policies if name in policies_with_points}
    rows = [
        {ROW_LABEL: f'<a href="#{anchor(axis.name)}">{escape(axis.name)}</a><small>{escape(axis.quantity)}</small>'}
        | {policy: cells.get((axis.name, policy), ABSENT) for policy in policies}
        for axis in severity_axes(results.cells)
        if axis.name in axes
    ]
    points_table = table({ROW_LABEL: "axis", **policies}, rows, "text")
    return section("Breaking points", note(BREAKING_LEAD), points_table) if rows else ""
