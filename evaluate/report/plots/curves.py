"""Curves against severity, one line a policy."""

from typing import TYPE_CHECKING

import numpy as np

from evaluate.analysis.comparison import FALL_RATE, RATES
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis
from evaluate.report.plots.drawing import figure, style, svg
from evaluate.statistics.breaking_point import LEAST_LEVELS, monotone_curve
from evaluate.statistics.intervals import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HEIGHT = 2.7
"""in"""
CURVE_POINTS = 60


def against_severity(results: Results, axis: SeverityAxis, metric: str, label: str) -> bytes:
    """Shares of successes or of falls with Wilson bands, the curve through them, and where it crosses one half; or a
    mean error with its 95 % band."""
    drawn, axes = figure(HEIGHT)
    if metric in RATES:
        _draw_rates(axes, results, axis, metric)
    else:
        for policy in results.policies:
            _draw_levels(axes, results, axis, policy, metric, "-")
        axes.set_ylim(bottom=0.0)
        _finish(axes, axis)
    axes.set(ylabel=label)
    return svg(drawn)


def _draw_rates(axes: "Axes", results: Results, axis: SeverityAxis, metric: str) -> None:
    of = "falls" if metric == FALL_RATE else "success"
    axes.axhline(50.0, color="#888888", linewidth=0.8, linestyle=(0, (4, 3)))
    for policy in results.policies:
        fitted = sum((level.name, policy) in results.summaries for level in axis.levels) >= LEAST_LEVELS
        severities, values = _draw_levels(axes, results, axis, policy, metric, "none" if fitted else "-")
        if fitted:
            across, fit = _curve(severities, values, of)
            axes.plot(across, fit, color=style(results, policy)[0], linewidth=1.4)
    for point in results.breaking_points:
        if (point.axis, point.of, point.found) == (axis.name, of, "crossed"):
            ends = np.clip(point.ci, point.lowest, point.highest)
            colour = style(results, point.policy)[0]
            axes.plot(ends, (50.0, 50.0), color=colour, linewidth=3.0, solid_capstyle="butt")
            axes.plot([point.severity50], [50.0], "|", color=colour, markersize=11, markeredgewidth=2)
    axes.set(ylim=(-3, 103), yticks=(0, 25, 50, 75, 100))
    _finish(axes, axis)


def _draw_levels(
    axes: "Axes", results: Results, axis: SeverityAxis, policy: str, metric: str, line: str
) -> tuple[Floats, Floats]:
    """Figures and a band between the ends of their intervals, an upright line where there is but one; gives the
    severities that the policy ran, and the figures."""
    rows = [
        (level.severity, getattr(summary, metric), *getattr(summary, f"{metric}_ci"))
        for level in axis.levels
        if (summary := results.summaries.get((level.name, policy)))
    ]
    severities, *figures = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    values, low, high = ((100.0 if metric in RATES else 1.0) * each for each in figures)
    if len(severities):
        colour, mark = style(results, policy)
        if len(severities) == 1:
            axes.vlines(severities, low, high, color=colour, alpha=0.55, linewidth=2.2)
        axes.fill_between(severities, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(severities, values, mark, color=colour, markersize=4, linewidth=1.4, linestyle=line, label=policy)
    return severities, values


def _curve(severities: Floats, values: Floats, of: str) -> tuple[Floats, Floats]:
    """Severities and per cent along the curve that the breaking point is read from."""
    failures = values / 100.0 if of == "falls" else 1.0 - values / 100.0
    x, shares = monotone_curve(severities, failures)
    order = np.argsort(x)
    across = np.geomspace(x.min(), x.max(), CURVE_POINTS)
    share = np.interp(np.log(across), np.log(x[order]), shares[order])
    return across, 100.0 * (share if of == "falls" else 1.0 - share)


def _finish(axes: "Axes", axis: SeverityAxis) -> None:
    """Harder to the right."""
    axes.set(xlabel=axis.quantity)
    if axis.falling:
        axes.invert_xaxis()
