"""Tables in Markdown."""

from collections.abc import Iterable, Mapping

from evaluate.analysis.comparison import METRICS
from evaluate.report.headings import TITLES, UNITS

IN_A_LINE = {metric: f"{TITLES[metric]}, {UNITS[metric]}".removesuffix(", ") for metric in METRICS}
"""Heading of each metric."""


def table(heads: Mapping[str, str], rows: Iterable[Mapping[str, str]]) -> str:
    """Headings, and the cells of each row, by column; the first column to the left."""
    first, *rest = (f"| {' | '.join(row[column] for column in heads)} |" for row in (heads, *rows))
    return "\n".join([first, f"|---|{'---:|' * (len(heads) - 1)}", *rest])
