"""Report section for each disturbance axis: curves over its levels, and tables of all measures.

A level is a scenario with one severity of the axis.
"""

from collections.abc import Iterator
from html import escape

from evaluate.analysis.comparison import FALL_RATE, SUCCESS_RATE
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, format_severity, severity_axes
from evaluate.report.html import collapsible, grid, image, note, section
from evaluate.report.plots import curves
from evaluate.report.sections.figures import comparison_table, figures_table
from quad_env.scenarios.scenario import Scenario

CURVE_LABELS = {SUCCESS_RATE: "episodes that succeed, %", FALL_RATE: "episodes with a fall, %"}
"""Name of a metric that is drawn -> label of the vertical axis of its plot."""
LEAD = (
    "Lines join the success or fall rates of the levels, bands their 95 % intervals. Marks on the line at one half: "
    "breaking points with their intervals. Severities are harder to the right. The marks of several policies at one "
    "level stand next to each other."
)
"""Explanation that the report shows above the curves of success and fall rate against severity."""


def render_axes(results: Results) -> str:
    """Render the sections of all disturbance axes as HTML, in the order of the run."""
    return "".join(
        section(_title(axis), *_parts(results, axis), anchor=anchor(axis.name)) for axis in severity_axes(results.cells)
    )


def anchor(axis: str) -> str:
    """Return the HTML identifier of the section of a disturbance `axis`, for links."""
    return f"axis-{axis.replace(' ', '-')}"


def _title(axis: SeverityAxis) -> str:
    """Return the title of the section of a disturbance `axis`, as HTML.

    It is the name of the axis, followed by the physical quantity of its severities. If the axis has only one severity,
    the severity follows instead.
    """
    at = format_severity(axis.scenarios[0]) if len(axis.levels) == 1 else axis.quantity
    return escape(axis.name) + (f" <small>{escape(at)}</small>" if at != axis.name else "")


def _parts(results: Results, axis: SeverityAxis) -> Iterator[str]:
    """Yield the parts of the section of an `axis` as HTML: note, curves, tables of measures, differences."""
    if axis.note:
        yield note(axis.note)
    if len(axis.levels) > 1:
        yield note(LEAD)
        plots = {
            label: curves.severity_curves_svg(results, axis, metric, label) for metric, label in CURVE_LABELS.items()
        }
        yield grid((image(plot, f"{label} of each policy against {axis.quantity}") for label, plot in plots.items()))
    tables = "".join(_figures(results, level) for level in axis.scenarios)
    yield collapsible("Every measure, with 95 % intervals", tables)
    yield _differences(results, axis)


def _figures(results: Results, level: Scenario) -> str:
    """Render a heading and the table of all measures on the scenario `level`, as HTML."""
    heading = f"<h3>{escape(level.name)} <small>{escape(format_severity(level))}</small></h3>"
    return f"{heading}{figures_table(results, level.name)}"


def _differences(results: Results, axis: SeverityAxis) -> str:
    """Render a collapsible table of differences in success on an `axis`, as HTML.

    The differences are between policies that are adjacent in the ranking, and between each policy and the baseline.
    """
    names = axis.scenario_names
    comparisons = [
        comparison
        for comparison in results.comparisons
        if comparison.scenario in names and comparison.metric == SUCCESS_RATE
    ]
    lead = note("Paired by episode, with 95 % intervals; p-values are corrected together with all other claims.")
    body = lead + comparison_table(comparisons) if comparisons else ""
    return collapsible("Differences of neighbours and from the baseline", body)
