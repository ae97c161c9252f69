"""Learning curves of training runs over steps: `python -m research curves RUN [RUN …]`.

Success and cost of transport are drawn. Runs that differ in their seed alone are one curve: their mean, with a band
from the lowest seed to the highest.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from evaluate.report.plots.drawing import COLOURS, MARKS
from policies.base import Floats
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.format import number
from quad_env.files.reading import MAX_DATA_SIZE, read_bytes
from train.learning_curve import DATE_METADATA, PANELS, make_axes, write_figure
from train.run_folder import VALIDATIONS_FILE
from train.run_record import flatten, load_settings, to_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_LABEL_LENGTH = 48
"""Largest length of the settings in a label, characters."""


@dataclass(frozen=True)
class CurvesOptions:
    """Draw learning curves."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of training runs, finished or not, for example runs/residual-*."""
    out: Path = Path("results/learning_curves.svg")
    """Picture to write, an .svg, .png or .pdf; replaced if it is there."""


def main(options: CurvesOptions) -> int:
    """Write the plot of the curves, print the last point of each curve, and return the exit code.

    Raises UsageError or OSError.
    """
    if options.out.suffix not in DATE_METADATA:
        raise UsageError(f"--out must end in {', '.join(DATE_METADATA)}, unlike {options.out}")
    runs = [read_curve(folder) for folder in options.runs]
    validated_runs = [run for run in runs if len(run.steps)]
    for run in runs:
        if not len(run.steps):
            print(f"{run.folder} has no validation yet: left out", file=sys.stderr)
    if not validated_runs:
        raise UsageError("no run with a validation to draw: name the folders of training runs, such as runs/residual-0")
    bands = group_by_seed(validated_runs)
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


@dataclass(frozen=True)
class RunCurve:
    """Learning curve of one run, made by `read_curve`."""

    folder: Path
    """Folder of the run."""
    settings: Mapping[str, Any]
    """Name of the option -> value, for all settings except the seed."""
    seed: int
    """Training seed."""
    steps: Floats
    """Number of training steps at each of the k validations, (k,)."""
    figures: Floats
    """Success rate (0 … 1) and cost of transport of the k validations, (2, k). A cost that is not recorded is NaN."""


@dataclass(frozen=True)
class SeedBand:
    """Curves of runs with the same settings and different seeds, made by `group_by_seed`."""

    label: str
    """Label of the curve in the legend."""
    runs: tuple[RunCurve, ...]
    """Curves of the runs, one for each seed."""

    @property
    def steps(self) -> Floats:
        """Numbers of training steps at which all runs of the group were validated, (k,)."""
        return reduce(np.intersect1d, [run.steps for run in self.runs])

    def over_seeds(self) -> tuple[Floats, Floats, Floats]:
        """Return mean, minimum and maximum over the seeds of success rate and cost of transport, each (2, k)."""
        figures = np.array([run.figures[:, np.isin(run.steps, self.steps)] for run in self.runs])
        return figures.mean(axis=0), figures.min(axis=0), figures.max(axis=0)


def read_curve(folder: Path) -> RunCurve:
    """Read the learning curve of the run in `folder`, also of a run of an older version.

    Raises UsageError if the folder has no run, or if the validations are damaged.
    """
    settings = dict(flatten(load_settings(folder)))
    path = folder / VALIDATIONS_FILE
    try:
        entries = json.loads(read_bytes(path, MAX_DATA_SIZE))["validations"] if path.exists() else []
        rows = {entry["steps"]: (entry["steps"], entry["success"], entry.get("cost_of_transport")) for entry in entries}
        columns = np.array(list(rows.values()), np.float64).reshape(-1, 3).T
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(f"{path} holds no validations of a training run: leave that run out") from None
    return RunCurve(folder, settings, settings.pop("seed", 0), columns[0], columns[1:])


def group_by_seed(runs: Sequence[RunCurve]) -> list[SeedBand]:
    """Group the runs that differ only in their seed.

    Raises UsageError if two runs of a group have the same seed.
    """
    groups = dict[str, list[RunCurve]]()
    for run in runs:
        group = groups.setdefault(json.dumps(run.settings, sort_keys=True), [])
        if same_seed := [other for other in group if other.seed == run.seed]:
            raise UsageError(f"{same_seed[0].folder} and {run.folder} are both seed {run.seed} of one recipe: name one")
        group.append(run)
    recipes = [group[0].settings for group in groups.values()]
    differing = [name for name in recipes[0] if any(recipe.get(name) != recipes[0][name] for recipe in recipes)]
    return [SeedBand(_label(group, differing or ["policy", "base"]), tuple(group)) for group in groups.values()]


def _label(runs: Sequence[RunCurve], options: Sequence[str]) -> str:
    """Return the label of a group of runs: values of the given options, and the seeds.

    If the values are too long, the label has the folder of the first run instead.
    """
    settings = ", ".join(f"{name} {to_words(runs[0].settings.get(name))}" for name in options)
    seeds = f"{len(runs)} seeds" if len(runs) > 1 else f"seed {runs[0].seed}"
    return f"{settings if len(settings) <= MAX_LABEL_LENGTH else runs[0].folder} ({seeds})"


def draw_bands(bands: Sequence[SeedBand]) -> "Figure":
    """Draw the learning curves: success, and in a panel below it cost of transport if any run has it."""
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
    """Draw a group of runs: the mean over the seeds, their range as a band, and each run as a thin line.

    Args:
        axes: Axes of the panel.
        band: Group of runs.
        row: Index of the panel, and row of the data: 0 for success, 1 for cost of transport.
        colour: Colour of lines and band.
        mark: Marker of the mean.
    """
    mean, low, high = (PANELS[row][1] * figures[row] for figures in band.over_seeds())
    axes.fill_between(band.steps, low, high, color=colour, alpha=0.18, linewidth=0)
    for run in band.runs if len(band.runs) > 1 else ():
        axes.plot(run.steps, PANELS[row][1] * run.figures[row], color=colour, alpha=0.4, linewidth=0.7)
    axes.plot(band.steps, mean, f"{mark}-", color=colour, linewidth=1.6, markersize=4, label=band.label)
