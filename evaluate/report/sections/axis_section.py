"""A section for each axis of the run: curves over its levels, and folded below them every figure."""

import math
from collections.abc import Iterator
from html import escape

from evaluate.analysis.comparison import FALL_RATE, SUCCESS_RATE
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, severity, severity_axes
from evaluate.report.html import fold, grid, image, note, section
from evaluate.report.plots import curves
from evaluate.report.sections.figures import comparison_table, figures_table, level_table, summary_table
from evaluate.statistics.breaking_point import LEAST_LEVELS
from quad_env.scenarios.named import Scenario

SHOWN = {
    SUCCESS_RATE: "episodes that succeed, %",
    FALL_RATE: "episodes with a fall, %",
    "velocity_error": "velocity error, m/s",
}
"""Metrics that are drawn, and what their figures are."""
FITTED = "Lines of success and falls: monotone curves, with the breaking point and its interval at one half."
JOINED = f"Lines of success and falls join the levels: fewer than {LEAST_LEVELS} have no breaking point."


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
        lines = FITTED if len(axis.levels) >= LEAST_LEVELS else JOINED
        yield note(f"Bands join the levels' 95 % intervals. {lines} Harder to the right.")
        plots = {label: curves.against_severity(results, axis, metric, label) for metric, label in SHOWN.items()}
        yield grid((image(plot, f"{label} of each policy against {axis.quantity}") for label, plot in plots.items()))
        yield level_table(results, axis)
        yield fold("Every figure", "".join(_figures(results, level) for level in axis.scenarios))
    else:
        scenario = axis.scenarios[0].name
        yield summary_table(results, scenario)
        yield fold("Every measure", figures_table(results, scenario))
    yield from _differences(results, axis)


def _differences(results: Results, axis: SeverityAxis) -> Iterator[str]:
    """Of neighbours in the ranking and from the baseline."""
    claimed = {(c.a, c.b) for c in results.comparisons if not math.isnan(c.p_value_holm) and c.metric == SUCCESS_RATE}
    shown = [c for c in results.comparisons if c.scenario in axis.scenario_names and (c.a, c.b) in claimed]
    lead = note("Paired by episode, with 95 % intervals; p-values are corrected together with all other claims.")
    yield fold(
        "Differences of neighbours and from the baseline", lead + comparison_table(results, shown) if shown else ""
    )


def _figures(results: Results, level: Scenario) -> str:
    every = fold("Every measure", figures_table(results, level.name))
    head = f"<h3>{escape(level.name)} <small>{escape(severity(level))}</small></h3>"
    return f"{head}{summary_table(results, level.name)}{every}"
