"""Learning curves as a picture: success and cost of transport over steps, a curve and a band for each recipe."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from evaluate.report.plots.drawing import COLOURS, MARKS, settings
from quad_env.files.writing import write_atomically
from train.curves.run import SeedBand

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DATES = {".svg": "Date", ".png": "Creation Time", ".pdf": "CreationDate"}
"""Formats, each with the name of its date, which is left out: the same runs give the same file."""
PANELS = ("success in validation, %", 100.0), ("cost of transport", 1.0)
"""Label and scale of each figure of a curve."""
WIDTH, PANEL, LINE = 5.6, 2.3, 0.2
"""Width of the picture, height of a pair of axes and of a line of the legend, in."""


def write_picture(bands: Sequence[SeedBand], out: Path, title: str = "") -> None:
    """Write the curves to a file of one of those formats, whole or not at all. Raises OSError."""
    content, dateless = io.BytesIO(), {DATES[out.suffix]: None}
    with settings():
        draw(bands, title).savefig(content, format=out.suffix[1:], dpi=160, facecolor="white", metadata=dateless)
    write_atomically(out, content.getvalue())


def draw(bands: Sequence[SeedBand], title: str = "") -> "Figure":
    """Success, and below it cost of transport if any run has it."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter

    costs = np.concatenate([run.figures[1] for band in bands for run in band.runs])
    count = 1 + int(np.isfinite(costs).any())
    drawn = Figure(figsize=(WIDTH, PANEL * count + LINE * (len(bands) + 2)), layout="constrained")
    panels = drawn.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for row, axes in enumerate(panels):
        for number, band in enumerate(bands):
            _draw_band(axes, band, row, COLOURS[number % len(COLOURS)], list(MARKS)[number % len(MARKS)])
        axes.set_ylabel(PANELS[row][0])
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#dddddd", linewidth=0.6)
    panels[0].set_title(title)
    panels[-1].set_xlabel("steps of the learner, all robots together")
    panels[-1].xaxis.set_major_formatter(EngFormatter(sep=""))
    several, entries = any(len(band.runs) > 1 for band in bands), panels[0].get_legend_handles_labels()
    note = "mean of the seeds, and their range" if several else None
    drawn.legend(*entries, loc="outside lower left", frameon=False, title=note, alignment="left")
    return drawn


def _draw_band(axes: "Axes", band: SeedBand, row: int, colour: str, mark: str) -> None:
    """Mean over the seeds, their range as a band, and each of several as a thin line."""
    mean, low, high = (PANELS[row][1] * figures[row] for figures in band.over_seeds())
    axes.fill_between(band.steps, low, high, color=colour, alpha=0.18, linewidth=0)
    for run in band.runs if len(band.runs) > 1 else ():
        axes.plot(run.steps, PANELS[row][1] * run.figures[row], color=colour, alpha=0.4, linewidth=0.7)
    axes.plot(band.steps, mean, f"{mark}-", color=colour, linewidth=1.6, markersize=4, label=band.label)
