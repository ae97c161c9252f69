"""Learning curves of training runs over steps: `python -m research curves RUN [RUN …]`.

RUN is the folder of a training run. The plot shows the success rate and the cost of transport at each validation. Runs
that differ only in their seed give one curve: the mean over the seeds, with a band from the smallest to the largest
value.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from evaluate.analysis.learning_curves import SeedBand, read_bands
from evaluate.report.plots.drawing import COLOURS, CURVE_PANELS, MARKS
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.format import number
from train.learning_curve import FORMATS, make_axes, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class CurvesOptions:
    """Options of the command `curves`, which plots learning curves of training runs."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of finished or unfinished training runs, for example runs/residual-*."""
    out: Path = Path("results/learning_curves.svg")
    """Plot to write, an .svg, .png or .pdf file; an existing file is replaced."""


def main(options: CurvesOptions) -> int:
    """Run the command `curves`: plot the learning curves, and print the last point of each curve.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An option is invalid, or no run has a validation.
    """
    if options.out.suffix not in FORMATS:
        raise UsageError(f"--out must end in {', '.join(FORMATS)}, unlike {options.out}")
    bands = read_bands(options.runs)
    make_folder_of(options.out, "--out")
    write_figure(partial(draw_bands, bands), options.out)
    for band in bands:
        if len(band.steps):
            mean, _, _ = band.over_seeds()
            success, cost = mean[:, -1]
            steps = band.steps[-1]
            print(f"{band.label}: success {success:.0%}, cost of transport {number(cost, 2)} after {steps:,.0f} steps")
    print(options.out)
    return 0


def draw_bands(bands: Sequence[SeedBand]) -> "Figure":
    """Plot the learning curves: success, and in a second panel the cost of transport if it was recorded.

    Args:
        bands: Groups of training runs, each with a curve in its own colour.

    Returns:
        The Matplotlib figure.
    """
    all_figures = np.concatenate([run.figures for band in bands for run in band.runs], axis=1)
    figure, panels = make_axes(all_figures, "", len(bands))
    marks = list(MARKS)
    for row, axes in enumerate(panels):
        for index, band in enumerate(bands):
            _draw_band(axes, band, row, COLOURS[index % len(COLOURS)], marks[index % len(marks)])
    has_bands = any(len(band.runs) > 1 for band in bands)
    note = "mean of the seeds, and their range" if has_bands else None
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", frameon=False, title=note, alignment="left")
    return figure


def _draw_band(axes: "Axes", band: SeedBand, row: int, colour: str, mark: str) -> None:
    """Plot a group of training runs: mean over the seeds, range of the seeds as a band, and each run.

    Args:
        axes: Matplotlib axes of the panel.
        band: Group of training runs.
        row: Index of the plotted quantity: 0 for success, 1 for cost of transport.
        colour: Colour of lines and band.
        mark: Matplotlib marker of the points of the mean.
    """
    mean, low, high = (CURVE_PANELS[row][1] * figures[row] for figures in band.over_seeds())
    axes.fill_between(band.steps, low, high, color=colour, alpha=0.18, linewidth=0)
    for run in band.runs if len(band.runs) > 1 else ():
        axes.plot(run.steps, CURVE_PANELS[row][1] * run.figures[row], color=colour, alpha=0.4, linewidth=0.7)
    axes.plot(band.steps, mean, f"{mark}-", color=colour, linewidth=1.6, markersize=4, label=band.label)
