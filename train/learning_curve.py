"""Draws the learning curve of a training run: success and cost of transport in its validations, over the steps."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evaluate.report.plots.drawing import COLOURS, CURVE_PANELS, plot_settings, write_image
from policies.base import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURE_WIDTH = 5.6
"""Width of the figure of a learning curve, inches."""
PANEL_HEIGHT = 2.3
"""Height of a panel of the figure of a learning curve, inches."""
LEGEND_LINE_HEIGHT = 0.2
"""Height that the figure of a learning curve reserves for each line of its legend, inches."""
FORMATS = (".svg", ".png", ".pdf")
"""Suffixes of the image files that `write_figure` writes."""


def write_curve(validations: Sequence[Mapping[str, Any]], out: Path) -> None:
    """Write the plot of the learning curve of a training run to a file.

    The title of the plot is the name of the folder of the file. OSError is raised if the file cannot be written.

    Args:
        validations: Results of all validations of the run, in order of steps. Each is a dictionary with the keys
            "steps", "success" and, in newer versions, "cost_of_transport".
        out: Image file to write; its suffix is one of `FORMATS`.
    """
    write_figure(partial(draw_curve, validations, out.parent.name), out)


def write_figure(draw: "Callable[[], Figure]", out: Path) -> None:
    """Draw a Matplotlib figure and write it to an image file.

    Raises OSError if the file cannot be written; an existing file is then unchanged.

    Args:
        draw: Function without arguments that draws and returns the figure.
        out: Image file to write; its suffix is one of `FORMATS`.
    """
    with plot_settings():
        write_image(draw, out, dpi=160)


def draw_curve(validations: Sequence[Mapping[str, Any]], title: str) -> "Figure":
    """Draw the learning curve of a training run: success and cost of transport over the learner steps.

    Validations of older versions have no cost of transport. The figure then has only the panel for success.

    Args:
        validations: Results of all validations of the run, in order of steps. Each is a dictionary with the keys
            "steps", "success" and, in newer versions, "cost_of_transport".
        title: Title of the figure.

    Returns:
        The figure.
    """
    names = ("steps", "success", "cost_of_transport")
    rows = np.array([[validation.get(name) for name in names] for validation in validations], np.float64)
    steps, *curves = rows.T
    figure, panels = make_axes(np.array(curves), title)
    for axes, values, (_, scale) in zip(panels, curves, CURVE_PANELS, strict=False):
        axes.plot(steps, scale * values, "o-", color=COLOURS[0], linewidth=1.6, markersize=4)
    return figure


def make_axes(figures: Floats, title: str, legend: int = 0) -> "tuple[Figure, Sequence[Axes]]":
    """Make the empty figure of a learning curve: a panel for success, and one for cost of transport if known.

    Args:
        figures: Success rate (0 to 1, row 0) and cost of transport (dimensionless, row 1) of k validations, (2, k). A
            number is NaN if it is unknown.
        title: Title of the figure.
        legend: Number of lines of the legend, for which space is left.

    Returns:
        The figure and the Matplotlib axes of its empty panels, from top to bottom.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter

    count = 1 + int(np.isfinite(figures[1]).any())
    height = PANEL_HEIGHT * count + LEGEND_LINE_HEIGHT * (legend + 2)
    figure = Figure(figsize=(FIGURE_WIDTH, height), layout="constrained")
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, _) in zip(panels, CURVE_PANELS, strict=False):
        axes.set_ylabel(label)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#dddddd", linewidth=0.6)
    panels[0].set_title(title)
    panels[-1].set_xlabel("steps of the learner, all robots together")
    panels[-1].xaxis.set_major_formatter(EngFormatter(sep=""))
    return figure, list(panels)
