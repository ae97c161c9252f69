"""Every axis in one table: where each policy breaks, with a way to the axis."""

from collections.abc import Mapping
from html import escape

from evaluate.analysis.breaking_point_text import CAVEAT, figure_and_interval
from evaluate.analysis.breaking_points import AxisBreakingPoint
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import severity_axes
from evaluate.report.html import note, section, table
from evaluate.report.sections.axis_section import anchor
from evaluate.report.sections.figures import policy_label
from evaluate.terminal.format import ABSENT, NO_BREAK

LEAD = (
    "Severity at which half of the episodes end in a fall, from a curve fitted through the levels, with its 95 % "
    f"interval. {CAVEAT} “None up to” is the hardest level tried; “already at” the mildest."
)


def overview(results: Results) -> str:
    """Breaking points, an axis a row; empty where no axis has levels enough."""
    cells = {(point.axis, point.policy): _cell(point) for point in results.breaking_points}
    found = {axis for axis, _ in cells}
    axes = {axis.name: axis.quantity for axis in severity_axes(results) if axis.name in found}
    return section("Breaking points", note(LEAD), by_axis(results, axes, cells)) if axes else ""


def by_axis(results: Results, axes: Mapping[str, str], cells: Mapping[tuple[str, str], str]) -> str:
    """A table of cells by axis and policy, ready HTML; below each axis's name stand its words, a text.

    Without the policies that have no cell.
    """
    policies = [policy for policy in results.policies if any(policy == found for _, found in cells)]
    rows = [
        [
            f'<a href="#{anchor(axis)}">{escape(axis)}</a><small>{escape(words)}</small>',
            *(cells.get((axis, policy), ABSENT) for policy in policies),
        ]
        for axis, words in axes.items()
    ]
    return table(["axis", *(policy_label(results, policy) for policy in policies)], rows, "text")


def _cell(point: AxisBreakingPoint) -> str:
    figure, ends = figure_and_interval(point)
    return f"{escape(figure)}<small>{escape(ends.replace(NO_BREAK, ' '))}</small>" if ends else escape(figure)
