"""Tables in Markdown."""

from collections.abc import Iterable, Mapping

from evaluate.analysis.comparison import ERRORS, METRICS
from evaluate.measures.catalogue import BY_NAME
from evaluate.report.headings import TITLES

IN_A_LINE = {metric: TITLES[metric] + (f", {BY_NAME[metric].unit}" if metric in ERRORS else "") for metric in METRICS}
"""Metric -> heading with its unit."""


def table(heads: Mapping[str, str], rows: Iterable[Mapping[str, str]]) -> str:
    """Format a table.

    Args:
        heads: Column -> heading; the first column is left-aligned.
        rows: Rows, each column -> cell.

    Returns:
        Markdown.
    """
    head, *body = (f"| {' | '.join(row[column] for column in heads)} |" for row in (heads, *rows))
    return "\n".join([head, f"|---|{'---:|' * (len(heads) - 1)}", *body])
