"""All axes together: success on each as a heat map, and breaking points."""

from collections.abc import Mapping
from html import escape

from evaluate.analysis.breaking_points import CAVEAT, HALF, Of, breaking_point_text
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import severity_axes
from evaluate.report.headings import FIRST
from evaluate.report.html import image, note, section, table, wide
from evaluate.report.plots import success
from evaluate.report.plots.drawing import svg
from evaluate.report.sections.axis_section import anchor
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import ABSENT

SUCCESS_LEAD = (
    "Episodes that succeed, in %: in each block the severities of an axis in this run, the mildest to the left. An "
    "episode succeeds if the robot stays upright and tracks its command within tolerance in every interval. Set apart "
    "on the right: with the robot's hardware profile."
)
BREAKING_LEAD = (
    "Severities at which half of the episodes no longer succeed, and fall, with their 95 % intervals. "
    f"{CAVEAT} “None up to” is the hardest level tried; “already at” the mildest."
)


def overview(results: Results) -> str:
    """The heat map and the breaking points, of what the run has of them."""
    found = {point.axis for point in results.breaking_points}
    axes = {axis.name: axis.quantity for axis in severity_axes(results.cells) if axis.name in found}
    tables = (_breaking_points(results, axes, of) for of in HALF)
    breaking = section("Breaking points", note(BREAKING_LEAD), *tables) if axes else ""
    return f"{_heat_map(results)}{breaking}"


def _heat_map(results: Results) -> str:
    """Empty of a run of one axis."""
    scores = results.scores, results.hardware_scores
    if all(len(each.axes) < 2 for kind in scores for each in kind):
        return ""
    drawn = image(svg(success.heat_map(*scores)), "Success of each policy on each axis at each severity, in per cent")
    return section("Success on every axis", note(SUCCESS_LEAD), wide(drawn))


def _breaking_points(results: Results, axes: Mapping[str, str], of: Of) -> str:
    """A table, headed by what breaks, of the policies that have a breaking point."""
    found = [point for point in results.breaking_points if point.of == of]
    cells = {(point.axis, point.policy): escape(breaking_point_text(point)) for point in found}
    policies = {name: policy_label(results, name) for name in results.policies if any(name == one for _, one in cells)}
    rows = [
        {FIRST: f'<a href="#{anchor(axis)}">{escape(axis)}</a><small>{escape(words)}</small>'}
        | {policy: cells.get((axis, policy), ABSENT) for policy in policies}
        for axis, words in axes.items()
    ]
    return f"<h3>{HALF[of].capitalize()}</h3>{table({FIRST: 'axis', **policies}, rows, 'text')}" if cells else ""
