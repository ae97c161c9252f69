"""Curves against severity, one line a policy."""

from typing import TYPE_CHECKING

import numpy as np

from evaluate.analysis.comparison import FALL_RATE
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis
from evaluate.report.plots.drawing import figure, style, svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HEIGHT = 2.7
"""in"""


def against_severity(results: Results, axis: SeverityAxis, metric: str, label: str) -> bytes:
    """Shares of successes or of falls with Wilson bands, and breaking points with their intervals at one half."""
    drawn, axes = figure(HEIGHT)
    axes.axhline(50.0, color="#888888", linewidth=0.8, linestyle=(0, (4, 3)))
    for policy in results.policies:
        _draw_levels(axes, results, axis, policy, metric)
    of = "falls" if metric == FALL_RATE else "success"
    for point in results.breaking_points:
        if (point.axis, point.of, point.found) == (axis.name, of, "crossed"):
            ends = np.clip(point.ci, point.lowest, point.highest)
            colour = style(results, point.policy)[0]
            axes.plot(ends, (50.0, 50.0), color=colour, linewidth=3.0, solid_capstyle="butt")
            axes.plot([point.severity50], [50.0], "|", color=colour, markersize=11, markeredgewidth=2)
    axes.set(ylim=(-3, 103), yticks=(0, 25, 50, 75, 100), xlabel=axis.quantity, ylabel=label)
    if axis.falling:
        axes.invert_xaxis()
    return svg(drawn)


def _draw_levels(axes: "Axes", results: Results, axis: SeverityAxis, policy: str, metric: str) -> None:
    """Per cent and a band between the ends of their intervals; an upright line where the policy ran one level."""
    rows = [
        (level.severity, getattr(summary, metric), *getattr(summary, f"{metric}_ci"))
        for level in axis.levels
        if (summary := results.summaries.get((level.name, policy)))
    ]
    if rows:
        severities, *shares = np.array(rows, dtype=np.float64).T
        values, low, high = (100.0 * each for each in shares)
        colour, mark = style(results, policy)
        if len(severities) == 1:
            axes.vlines(severities, low, high, color=colour, alpha=0.55, linewidth=2.2)
        axes.fill_between(severities, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(severities, values, mark, color=colour, markersize=4, linewidth=1.4, linestyle="-", label=policy)
