"""Every axis in one table: where each policy breaks, with a way to the axis."""

from collections.abc import Mapping
from html import escape

from evaluate.analysis.breaking_point_text import parts
from evaluate.analysis.breaking_points import Limit
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import ladders
from evaluate.report.html import note, section, table
from evaluate.report.sections.axis_section import anchor
from evaluate.report.sections.figures import named
from evaluate.terminal.format import ABSENT, NO_BREAK

LEAD = (
    "Severity at which half of the episodes end in a fall, from a curve fitted through the levels, with its 95 % "
    "interval. “None up to” is the hardest level tried; “already at” the mildest."
)


def overview(results: Results) -> str:
    """Breaking points, an axis a row; empty where no axis has levels enough."""
    cells = {(limit.axis, limit.policy): _cell(limit) for limit in results.breaking_points}
    found = {axis for axis, _ in cells}
    axes = {ladder.name: ladder.quantity for ladder in ladders(results) if ladder.name in found}
    return section("Breaking points", note(LEAD), by_axis(results, axes, cells)) if axes else ""


def by_axis(results: Results, axes: Mapping[str, str], cells: Mapping[tuple[str, str], str]) -> str:
    """A table of cells by axis and policy, ready HTML; below each axis's name stand its words, a text."""
    rows = [
        [
            f'<a href="#{anchor(axis)}">{escape(axis)}</a><small>{escape(words)}</small>',
            *(cells.get((axis, policy), ABSENT) for policy in results.policies),
        ]
        for axis, words in axes.items()
    ]
    return table(["axis", *(named(results, policy) for policy in results.policies)], rows, "text")


def _cell(limit: Limit) -> str:
    figure, ends = parts(limit)
    return f"{escape(figure)}<small>{escape(ends.replace(NO_BREAK, ' '))}</small>" if ends else escape(figure)
