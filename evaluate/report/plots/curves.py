"""Plot of success or fall rate against the severity of a disturbance, with one line for each policy.

A level is a scenario with one severity of a disturbance axis. A breaking point is the severity at which the rate
crosses one half.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from evaluate.analysis.comparison import FALL_RATE
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis
from evaluate.report.plots.drawing import (
    Margins,
    add_legend,
    figure_to_svg,
    legend_height,
    make_figure,
    short_name,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Transform

HEIGHT = 2.7
"""Height of the plot of success or fall rate against severity, without its legend, inches."""
WIDEST = 2.6
"""Width of the line of the first policy in a plot of success or fall rate against severity, pt."""
NARROWEST = 1.2
"""Width of the line of the last policy in a plot of success or fall rate against severity, pt.

Each line is narrower than the earlier lines, which it may cover, so that the edges of the earlier lines stay visible.
"""
DASHES = ("solid", (0, (5, 3)), (0, (2, 2)), (0, (6, 2, 1, 2)))
"""Matplotlib line styles of successive policies; they repeat if there are more policies."""
STEP = 3.0
"""Largest horizontal shift between the marks of two successive policies at the same severity, pt.

Marks are shifted so that equal curves stay visible.
"""
SPREAD = 14.0
"""Largest horizontal shift between the marks of the first and the last policy at the same severity, pt.

Marks are shifted so that equal curves stay visible.
"""
BAR = 2.5
"""Line width of the interval of a breaking point in a plot, pt."""


def severity_curves_svg(results: Results, axis: SeverityAxis, metric: str, label: str) -> bytes:
    """Draw success or fall rate against severity, with Wilson intervals and breaking points, as SVG.

    Args:
        results: Results of the run.
        axis: Disturbance axis (kind of disturbance, such as pushes) with its scenarios, one for each severity.
        metric: Name of the rate to draw: `success_rate` or `fall_rate`.
        label: Label of the vertical axis.

    Returns:
        Contents of an SVG file.
    """
    return figure_to_svg(draw_severity_curves(results, axis, metric, label))


def draw_severity_curves(results: Results, axis: SeverityAxis, metric: str, label: str) -> "Figure":
    """Draw success or fall rate against severity, with Wilson intervals and breaking points.

    Equal curves are shifted apart, so that all curves are visible.

    Args:
        results: Results of the run.
        axis: Disturbance axis (kind of disturbance, such as pushes) with its scenarios, one for each severity.
        metric: Name of the rate to draw: `success_rate` or `fall_rate`.
        label: Label of the vertical axis.

    Returns:
        The matplotlib figure.
    """
    policies = [
        name for name in results.policies if any((level.name, name) in results.summaries for level in axis.levels)
    ]
    legend = legend_height(len(policies))
    figure, axes = make_figure(HEIGHT + legend, margins=Margins(bottom=Margins.bottom + legend + 0.05))
    axes.axhline(50.0, color="#888888", linewidth=0.8, linestyle=(0, (4, 3)))
    for index, policy in enumerate(policies):
        _draw_levels(axes, results, axis, policy, metric, index, len(policies))
    _draw_breaking_points(axes, results, axis, metric, policies)
    axes.set(ylim=(-3, 103), yticks=(0, 25, 50, 75, 100), xlabel=axis.quantity, ylabel=label)
    if axis.is_harder_when_smaller:
        axes.invert_xaxis()
    add_legend(figure)
    return figure


def _draw_breaking_points(
    axes: "Axes", results: Results, axis: SeverityAxis, metric: str, policies: Sequence[str]
) -> None:
    """Draw the breaking point of each policy with its interval near the line at 50 %, one above the other."""
    kind = "falls" if metric == FALL_RATE else "success"
    for point in results.breaking_points:
        if (point.axis, point.of, point.found) != (axis.name, kind, "crossed"):
            continue
        ends = np.clip(point.ci, point.lowest, point.highest)
        colour, _ = style(results, point.policy)
        offset = _mark_offset(policies.index(point.policy), len(policies), BAR + 0.5)
        shifted = _shifted_data(axes, 0.0, offset)
        axes.plot(ends, (50.0, 50.0), color=colour, linewidth=BAR, solid_capstyle="butt", transform=shifted)
        axes.plot([point.severity50], [50.0], "|", color=colour, markersize=9, markeredgewidth=2, transform=shifted)


def _draw_levels(
    axes: "Axes", results: Results, axis: SeverityAxis, policy: str, metric: str, index: int, count: int
) -> None:
    """Draw the rate of one policy, %, against severity, with a band between the ends of 95 % intervals.

    If the policy ran only one severity of the axis, its interval is a vertical line.

    Args:
        axes: Matplotlib axes to draw on.
        results: Results of the run.
        axis: Disturbance axis (kind of disturbance, such as pushes) with its scenarios, one for each severity.
        policy: Name of the policy.
        metric: Name of the rate to draw: `success_rate` or `fall_rate`.
        index: Index of the policy among all drawn policies.
        count: Number of drawn policies.
    """
    rows = [
        (level.severity, getattr(summary, metric), *getattr(summary, f"{metric}_ci"))
        for level in axis.levels
        if (summary := results.summaries.get((level.name, policy)))
    ]
    if not rows:
        return
    severities, rates, lows, highs = np.array(rows, dtype=np.float64).T
    low = 100.0 * lows
    high = 100.0 * highs
    colour, mark = style(results, policy)
    shifted = _shifted_data(axes, _mark_offset(index, count, STEP), 0.0)
    width = WIDEST - (WIDEST - NARROWEST) * index / max(1, count - 1)
    if len(severities) == 1:
        axes.vlines(severities, low, high, color=colour, alpha=0.55, linewidth=2.2, transform=shifted)
    axes.fill_between(severities, low, high, color=colour, alpha=min(0.15, 0.45 / count), linewidth=0)
    axes.plot(
        severities, 100.0 * rates, mark, color=colour, markersize=4, linewidth=width, zorder=3 + index,
        transform=shifted, linestyle=DASHES[index % len(DASHES)], label=short_name(policy),
    )  # fmt: skip


def _mark_offset(index: int, count: int, step: float) -> float:
    """Return the horizontal or vertical offset of the marks of a policy from the centre of all marks, pt.

    `index` is the index of the policy among the `count` drawn policies. `step` is the largest offset between two
    successive policies, pt.
    """
    return (index - (count - 1) / 2) * min(step, SPREAD / max(1, count - 1))


def _shifted_data(axes: "Axes", right: float, up: float) -> "Transform":
    """Return a matplotlib transform from data to display coordinates, shifted by `right` and `up`, pt."""
    from matplotlib.transforms import ScaledTranslation

    return axes.transData + ScaledTranslation(right / 72.0, up / 72.0, axes.figure.dpi_scale_trans)
