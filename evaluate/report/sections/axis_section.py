"""A section for each axis of the run: curves over its levels, and folded below them every figure."""

from collections.abc import Iterator
from html import escape

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, severity, severity_axes
from evaluate.report.html import fold, grid, image, note, section
from evaluate.report.plots import curves
from evaluate.report.plots.drawing import cell_of
from evaluate.report.sections.figures import comparison_table, figures_table, level_table, summary_table
from evaluate.report.sections.push_section import pushes
from evaluate.statistics.breaking_point import LEAST_LEVELS
from quad_env.scenarios.named import Scenario

SUCCESS = ("success_rate", "episodes that succeed, %", 100.0)
FALLS = ("fall_rate", "episodes with a fall, %", 100.0)
ERROR = ("velocity_error", "velocity error, m/s", 1.0)
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
    if len(axis.levels) > 1:
        lines = FITTED if len(axis.levels) >= LEAST_LEVELS else JOINED
        yield note(f"Bands join the levels' 95 % intervals. {lines} Harder to the right.")
        yield grid(_curves(results, axis), 2)
        yield level_table(results, axis)
        yield pushes(results, axis)
        yield fold("Every figure", "".join(_figures(results, level) for level in axis.scenarios))
    else:
        scenario = axis.scenarios[0].name
        yield grid((_bars(results, scenario, figure) for figure in (SUCCESS, FALLS, ERROR)), 2)
        yield summary_table(results, scenario)
        yield pushes(results, axis)
        yield fold("Every measure", figures_table(results, scenario))
    yield from _differences(results, axis)


def _differences(results: Results, axis: SeverityAxis) -> Iterator[str]:
    baseline = results.baseline
    shown = [c for c in results.comparisons if c.scenario in axis.scenario_names]
    against = [c for c in shown if c.b == baseline]
    lead = note("Paired by episode. p-values are corrected for their number (Holm).")
    yield fold(f"Differences from {escape(baseline)}", lead + comparison_table(results, against) if against else "")
    others = [c for c in shown if c.b != baseline]
    yield fold("Differences of every other pair", lead + comparison_table(results, others) if others else "")
    yield fold("Episode by episode", _episodes(results, axis))


def _figures(results: Results, level: Scenario) -> str:
    every = fold("Every measure", figures_table(results, level.name))
    head = f"<h3>{escape(level.name)} <small>{escape(severity(level))}</small></h3>"
    return f"{head}{summary_table(results, level.name)}{every}"


def _curves(results: Results, axis: SeverityAxis) -> Iterator[str]:
    for metric, label, _ in (SUCCESS, FALLS):
        yield image(curves.rates(results, axis, metric, label), f"{label} of each policy against {axis.quantity}")
    metric, label, _ = ERROR
    yield image(curves.errors(results, axis, metric, label), f"{label} of each policy against {axis.quantity}")


def _bars(results: Results, scenario: str, figure: tuple[str, str, float]) -> str:
    metric, label, scale = figure
    return image(curves.intervals(results, scenario, metric, label, scale), f"{label} of each policy on {scenario}")


def _episodes(results: Results, axis: SeverityAxis) -> str:
    """Paired scatter on the nominal scenario of the axis, else on its mildest level."""
    scenario = axis.nominal.name
    baseline = cell_of(results, scenario, results.baseline)
    others = [cell_of(results, scenario, policy) for policy in results.policies if policy != results.baseline]
    present = [cell for cell in others if cell is not None]
    if baseline is None or not present:
        return ""
    lead = note(
        f"Velocity error of each episode of {scenario}, {baseline.policy} across: below the line a policy did better."
    )
    return lead + grid(
        [image(curves.paired(results, present, baseline), f"Velocity errors on {scenario}, by episode")], 2
    )
