"""A section for each axis of the run: curves over its levels, and folded below them every figure."""

from collections.abc import Iterator
from html import escape

from evaluate.analysis.comparison import FALL_RATE, SUCCESS_RATE
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, severity, severity_axes
from evaluate.report.html import fold, grid, image, note, section
from evaluate.report.plots import curves
from evaluate.report.sections.figures import comparison_table, figures_table

SHOWN = {SUCCESS_RATE: "episodes that succeed, %", FALL_RATE: "episodes with a fall, %"}
"""Metrics that are drawn, and what their figures are."""
LEAD = (
    "Bands join the levels' 95 % intervals, lines the levels; about the line at one half: breaking points with their "
    "intervals. Harder to the right. At each level the marks of several policies stand next to each other."
)


def disturbances(results: Results) -> str:
    """Every axis, in the order of the run."""
    return "".join(
        section(_title(axis), *_parts(results, axis), anchor=anchor(axis.name)) for axis in severity_axes(results.cells)
    )


def anchor(axis: str) -> str:
    """Where the page shows an axis."""
    return f"axis-{axis.replace(' ', '-')}"


def _title(axis: SeverityAxis) -> str:
    at = severity(axis.scenarios[0]) if len(axis.levels) == 1 else axis.quantity
    return escape(axis.name) + (f" <small>{escape(at)}</small>" if at != axis.name else "")


def _parts(results: Results, axis: SeverityAxis) -> Iterator[str]:
    if axis.note:
        yield note(axis.note)
    if len(axis.levels) > 1:
        yield note(LEAD)
        plots = {label: curves.against_severity(results, axis, metric, label) for metric, label in SHOWN.items()}
        yield grid((image(plot, f"{label} of each policy against {axis.quantity}") for label, plot in plots.items()))
    tables = (
        f"<h3>{escape(level.name)} <small>{escape(severity(level))}</small></h3>{figures_table(results, level.name)}"
        for level in axis.scenarios
    )
    yield fold("Every measure, with 95 % intervals", "".join(tables))
    yield from _differences(results, axis)


def _differences(results: Results, axis: SeverityAxis) -> Iterator[str]:
    """Of neighbours in the ranking and from the baseline."""
    names = axis.scenario_names
    shown = [each for each in results.comparisons if each.scenario in names and each.metric == SUCCESS_RATE]
    lead = note("Paired by episode, with 95 % intervals; p-values are corrected together with all other claims.")
    yield fold("Differences of neighbours and from the baseline", lead + comparison_table(shown) if shown else "")
