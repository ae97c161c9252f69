"""Fall rates along the axes of a run as a picture: a panel an axis, a curve a policy."""

import io
from pathlib import Path

import numpy as np

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import severity_axes
from evaluate.report.plots.drawing import style
from policies.files import write_atomically

COLUMNS = 4
"""Panels side by side."""


def write_picture(results: Results, path: Path) -> None:
    """Draw the curves with their 95 % intervals, the mildest level first, as SVG or PNG by the file's name."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    axes = severity_axes(results)
    rows, columns = -(-len(axes) // COLUMNS), min(COLUMNS, len(axes))
    figure = Figure(figsize=(3.2 * columns, 2.6 * rows + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, axis in zip(panels, axes, strict=False):
        names = [level.name for level in axis.levels]
        for policy in results.policies:
            ran = [place for place, name in enumerate(names) if (name, policy) in results.summaries]
            found = [results.summaries[names[place], policy] for place in ran]
            colour, mark = style(results, policy)
            panel.plot(ran, [each.fall_rate for each in found], marker=mark, markersize=3, color=colour, label=policy)
            lows, highs = np.array([each.fall_rate_ci for each in found]).reshape(-1, 2).T
            panel.fill_between(ran, lows, highs, color=colour, alpha=0.15, linewidth=0)
        panel.set_xticks(range(len(names)), [f"{level.severity:g}" for level in axis.levels])
        panel.set_title(axis.name.replace("_", " "), fontsize=9, loc="left")
        panel.set_xlabel(axis.unit, fontsize=8)
        panel.set_ylim(-0.03, 1.03)
        panel.tick_params(labelsize=7)
    for panel in panels[len(axes) :]:
        panel.set_visible(False)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=4, fontsize=8)
    buffer, kind = io.BytesIO(), path.suffix[1:]
    figure.savefig(buffer, format=kind, dpi=120, metadata={"Date": None} if kind == "svg" else None)
    write_atomically(path, buffer.getvalue())
