"""Learning curve of a training run: a plot of success and cost of transport of its validations."""

import io
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evaluate.report.plots.drawing import COLOURS, plot_settings
from policies.base import Floats
from quad_env.files.writing import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = (("success in validation, %", 100.0), ("cost of transport", 1.0))
"""Label of the vertical axis of each panel, and the factor that converts the data to the unit of the label."""
FIGURE_WIDTH = 5.6
"""Width of the figure, inches."""
PANEL_HEIGHT = 2.3
"""Height of a panel of the figure, inches."""
LEGEND_LINE_HEIGHT = 0.2
"""Height of a line of the legend, inches."""
DATE_METADATA = {".svg": "Date", ".png": "Creation Time", ".pdf": "CreationDate"}
"""File suffix -> metadata field with the date. No date is written, so that equal runs give identical files."""


def write_curve(validations: Sequence[Mapping[str, Any]], out: Path) -> None:
    """Write the learning curve of `validations` to the file `out`.

    The title is the name of the folder.

    OSError is raised if the file cannot be written.

    Args:
        validations: Validations of a run, in order.
        out: File to write.
    """
    write_figure(partial(draw_curve, validations, out.parent.name), out)


def write_figure(draw: "Callable[[], Figure]", out: Path) -> None:
    """Draw a figure and write it to a file. Raises OSError, and then leaves an existing file unchanged.

    Args:
        draw: Function that draws the figure.
        out: File to write; its suffix is a key of `DATE_METADATA`.
    """
    content = io.BytesIO()
    metadata = {DATE_METADATA[out.suffix]: None}
    with plot_settings():
        draw().savefig(content, format=out.suffix[1:], dpi=160, facecolor="white", metadata=metadata)
    write_atomically(out, content.getvalue())


def draw_curve(validations: Sequence[Mapping[str, Any]], title: str) -> "Figure":
    """Draw the learning curve of `validations` with a `title`.

    The validations of older versions have no cost of transport; the panel of the cost is then left out.

    Args:
        validations: Validations of a run, in order.
        title: Title of the figure.

    Returns:
        The figure.
    """
    names = ("steps", "success", "cost_of_transport")
    rows = np.array([[validation.get(name) for name in names] for validation in validations], np.float64)
    steps, *curves = rows.T
    figure, panels = make_axes(np.array(curves), title)
    for axes, values, (_, scale) in zip(panels, curves, PANELS, strict=False):
        axes.plot(steps, scale * values, "o-", color=COLOURS[0], linewidth=1.6, markersize=4)
    return figure


def make_axes(figures: Floats, title: str, legend: int = 0) -> "tuple[Figure, Sequence[Axes]]":
    """Make a figure with a panel for success over steps, and one for cost of transport if known.

    Args:
        figures: Success and cost of transport of k validations, (2, k); NaN where unknown.
        title: Title of the figure.
        legend: Number of lines of the legend, for which space is left.

    Returns:
        The figure and the axes of its panels, from top to bottom; the panels are empty.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter

    count = 1 + int(np.isfinite(figures[1]).any())
    height = PANEL_HEIGHT * count + LEGEND_LINE_HEIGHT * (legend + 2)
    figure = Figure(figsize=(FIGURE_WIDTH, height), layout="constrained")
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, _) in zip(panels, PANELS, strict=False):
        axes.set_ylabel(label)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#dddddd", linewidth=0.6)
    panels[0].set_title(title)
    panels[-1].set_xlabel("steps of the learner, all robots together")
    panels[-1].xaxis.set_major_formatter(EngFormatter(sep=""))
    return figure, list(panels)
