"""Learning curve of a training run: success and cost of transport of its validations, as a picture."""

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

PANELS = ("success in validation, %", 100.0), ("cost of transport", 1.0)
"""Label and scale of each figure of a curve."""
FIGURE_WIDTH, PANEL_HEIGHT, LEGEND_LINE_HEIGHT = 5.6, 2.3, 0.2
"""Width of the picture, height of a pair of axes and of a line of the legend, in."""


DATE_METADATA = {".svg": "Date", ".png": "Creation Time", ".pdf": "CreationDate"}
"""Formats, each with the name of its date, which is left out: the same runs give the same file."""


def write_curve(validations: Sequence[Mapping[str, Any]], out: Path) -> None:
    """Write the curve of a run's validations, titled as its folder, see `write_figure`. Raises OSError."""
    write_figure(partial(draw_curve, validations, out.parent.name), out)


def write_figure(draw: "Callable[[], Figure]", out: Path) -> None:
    """Write what is drawn to a file of one of those formats, whole or not at all. Raises OSError."""
    content, dateless = io.BytesIO(), {DATE_METADATA[out.suffix]: None}
    with plot_settings():
        draw().savefig(content, format=out.suffix[1:], dpi=160, facecolor="white", metadata=dateless)
    write_atomically(out, content.getvalue())


def draw_curve(validations: Sequence[Mapping[str, Any]], title: str) -> "Figure":
    """The curve of validations, those of older versions without a cost of transport too."""
    names = "steps", "success", "cost_of_transport"
    steps, *figures = np.array([[each.get(name) for name in names] for each in validations], np.float64).T
    drawn, panels = make_axes(np.array(figures), title)
    for axes, values, (_, scale) in zip(panels, figures, PANELS, strict=False):
        axes.plot(steps, scale * values, "o-", color=COLOURS[0], linewidth=1.6, markersize=4)
    return drawn


def make_axes(figures: Floats, title: str, legend: int = 0) -> "tuple[Figure, Sequence[Axes]]":
    """Axes of success over steps, and below them of cost of transport if any of the figures, (2, k), has it; with room
    for so many lines of a legend."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter

    count = 1 + int(np.isfinite(figures[1]).any())
    drawn = Figure(
        figsize=(FIGURE_WIDTH, PANEL_HEIGHT * count + LEGEND_LINE_HEIGHT * (legend + 2)), layout="constrained"
    )
    panels = drawn.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, _) in zip(panels, PANELS, strict=False):
        axes.set_ylabel(label)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#dddddd", linewidth=0.6)
    panels[0].set_title(title)
    panels[-1].set_xlabel("steps of the learner, all robots together")
    panels[-1].xaxis.set_major_formatter(EngFormatter(sep=""))
    return drawn, list(panels)
