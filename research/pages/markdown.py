"""Function that formats Markdown tables, and headings of table columns for metrics."""

from collections.abc import Iterable, Mapping

from evaluate.analysis.comparison import ERRORS, METRICS
from evaluate.measures.catalogue import BY_NAME
from evaluate.report.headings import TITLES

IN_A_LINE = {metric: TITLES[metric] + (f", {BY_NAME[metric].unit}" if metric in ERRORS else "") for metric in METRICS}
"""Name of a metric -> heading of the metric's column in a table, on one line; errors have their unit."""


def table(heads: Mapping[str, str], rows: Iterable[Mapping[str, str]]) -> str:
    """Format a Markdown table.

    Args:
        heads: Name of the column -> heading. The first column is left-aligned, all others are right-aligned.
        rows: Rows of the table; each row is a dictionary: name of the column -> text of the cell.

    Returns:
        The table as text.
    """
    head, *body = (f"| {' | '.join(row[column] for column in heads)} |" for row in (heads, *rows))
    return "\n".join([head, f"|---|{'---:|' * (len(heads) - 1)}", *body])
