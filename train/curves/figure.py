"""Learning curves as a picture: success and cost of transport over steps, a curve and a band for each recipe."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from evaluate.report.plots import drawing
from quad_env.files.writing import write_atomically
from train.curves.run import SeedBand

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKS = "os^DvPX"
FORMATS = (".svg", ".png", ".pdf")
PANELS = ("success in validation, %", 100.0), ("cost of transport", 1.0)
"""Label and scale of each figure of a curve."""
WIDTH, PANEL, LINE = 5.6, 2.3, 0.2
"""Width of the picture, height of a pair of axes and of a line of the legend, in."""


def write_picture(bands: Sequence[SeedBand], out: Path, title: str = "") -> None:
    """Write the curves to a file of one of FORMATS, whole or not at all. Raises OSError."""
    content, dated = io.BytesIO(), {".svg": "Date", ".pdf": "CreationDate"}.get(out.suffix)
    with drawing.settings():
        metadata = {dated: None} if dated else None
        draw(bands, title).savefig(content, format=out.suffix[1:], dpi=160, facecolor="white", metadata=metadata)
    write_atomically(out, content.getvalue())


def draw(bands: Sequence[SeedBand], title: str = "") -> "Figure":
    """Success, and cost of transport if any run has it, each with its curves one above the other."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter

    costs = np.concatenate([run.figures[1] for band in bands for run in band.runs])
    rows = PANELS if np.isfinite(costs).any() else PANELS[:1]
    size = WIDTH, PANEL * len(rows) + LINE * (len(bands) + 2)
    drawn = Figure(figsize=size, layout="constrained")
    panels = drawn.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    for row, axes in enumerate(panels):
        for number, band in enumerate(bands):
            _draw_band(axes, band, row, drawing.COLOURS[number % len(drawing.COLOURS)], MARKS[number % len(MARKS)])
        axes.set_ylabel(rows[row][0])
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#dddddd", linewidth=0.6)
    panels[0].set_title(title)
    panels[-1].set_xlabel("steps of the learner, all robots together")
    panels[-1].xaxis.set_major_formatter(EngFormatter(sep=""))
    note = "mean, lowest and highest of the seeds" if any(len(band.runs) > 1 for band in bands) else None
    handles = panels[0].get_legend_handles_labels()
    drawn.legend(*handles, loc="outside lower left", frameon=False, title=note, alignment="left")
    return drawn


def _draw_band(axes: "Axes", band: SeedBand, row: int, colour: str, mark: str) -> None:
    """Mean over the seeds, their range as a band, and each of several as a thin line."""
    scale = PANELS[row][1]
    mean, low, high = (scale * figures[row] for figures in band.over_seeds())
    axes.fill_between(band.steps, low, high, color=colour, alpha=0.18, linewidth=0)
    for run in band.runs if len(band.runs) > 1 else ():
        axes.plot(run.steps, scale * run.figures[row], color=colour, alpha=0.4, linewidth=0.7)
    axes.plot(band.steps, mean, f"{mark}-", color=colour, linewidth=1.6, markersize=4, label=band.label)
