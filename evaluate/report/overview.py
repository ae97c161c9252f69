"""Every axis in one table: where each policy breaks, with a way to the axis."""

from html import escape

from evaluate.format import ABSENT, NO_BREAK
from evaluate.ladders import ladders
from evaluate.limit_text import parts
from evaluate.limits import Limit
from evaluate.report.disturbances import anchor
from evaluate.report.figures import named
from evaluate.report.html import note, section, table
from evaluate.results import Results

LEAD = (
    "Severity at which half of the episodes end in a fall, from a curve fitted through the levels, with its 95 % "
    "interval. “None up to” is the hardest level tried; “already at” the mildest."
)


def overview(results: Results) -> str:
    """Breaking points, an axis a row; empty where no axis has levels enough."""
    limits = {(limit.axis, limit.policy): limit for limit in results.breaking_points}
    rows = [
        [
            f'<a href="#{anchor(ladder.name)}">{escape(ladder.name)}</a><small>{escape(ladder.quantity)}</small>',
            *(
                _cell(limits[ladder.name, policy]) if (ladder.name, policy) in limits else ABSENT
                for policy in results.policies
            ),
        ]
        for ladder in ladders(results)
        if any(axis == ladder.name for axis, _ in limits)
    ]
    heads = ["axis", *(named(results, policy) for policy in results.policies)]
    return section("Breaking points", note(LEAD), table(heads, rows, "text")) if rows else ""


def _cell(limit: Limit) -> str:
    figure, ends = parts(limit)
    return f"{escape(figure)}<small>{escape(ends.replace(NO_BREAK, ' '))}</small>" if ends else escape(figure)
