"""Curves of a rate against severity, one line for each policy."""

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
"""in. Height of the axes with their labels."""
WIDEST = 2.6
"""pt. Width of the first line."""
NARROWEST = 1.2
"""pt. Width of the last line: it covers only the middle of those below it."""
DASHES = ("solid", (0, (5, 3)), (0, (2, 2)), (0, (6, 2, 1, 2)))
"""Line styles, in turn."""
STEP = 3.0
"""pt. Distance of the marks of two policies at one severity."""
SPREAD = 14.0
"""pt. Largest spread of the marks of all policies at one severity."""
BAR = 2.5
"""pt. Line width of the interval of a breaking point."""


def severity_curves_svg(results: Results, axis: SeverityAxis, metric: str, label: str) -> bytes:
    """Draw a rate against severity with Wilson bands, and breaking points with their intervals.

    Args:
        results: Results of the run.
        axis: Axis of disturbance.
        metric: Rate to draw.
        label: Label of the vertical axis.

    Returns:
        SVG.
    """
    return figure_to_svg(draw_severity_curves(results, axis, metric, label))


def draw_severity_curves(results: Results, axis: SeverityAxis, metric: str, label: str) -> "Figure":
    """Draw the figure of `severity_curves_svg`; equal curves lie next to each other, none hides another.

    Args:
        results: Results of the run.
        axis: Axis of disturbance.
        metric: Rate to draw.
        label: Label of the vertical axis.

    Returns:
        The figure.
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
    """Draw the breaking points of a rate with their intervals at one half, next to each other."""
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
    """Draw the rate of one policy, %, with a band between the ends of its intervals.

    A policy with one level is an upright line.

    Args:
        axes: Axes to draw on.
        results: Results of the run.
        axis: Axis of disturbance.
        policy: Policy of the curve.
        metric: Rate to draw.
        index: Index of the policy among the drawn ones, from 0.
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
    """Return the distance of a policy's marks from the middle of all policies' marks, pt."""
    return (index - (count - 1) / 2) * min(step, SPREAD / max(1, count - 1))


def _shifted_data(axes: "Axes", right: float, up: float) -> "Transform":
    """Return data coordinates shifted on the page, pt."""
    from matplotlib.transforms import ScaledTranslation

    return axes.transData + ScaledTranslation(right / 72.0, up / 72.0, axes.figure.dpi_scale_trans)
