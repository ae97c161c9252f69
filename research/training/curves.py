"""Learning curves of training runs over steps: `python -m research curves RUN [RUN …]`.

RUN is the folder of a training run. The plot shows the success rate and the cost of transport at each validation. Runs
that differ only in their seed give one curve: the mean over the seeds, with a band from the smallest to the largest
value.
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
"""Maximum length of the training settings in the label of a curve, characters.

If the settings are longer, the label shows the folder of a training run instead.
"""


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
    """Learning curve of one training run, made by `read_curve`."""

    folder: Path
    """Folder of the training run."""
    settings: Mapping[str, Any]
    """Training settings except the seed: name of the option -> value."""
    seed: int
    """Seed of the training run."""
    steps: Floats
    """Number of training steps before each of the k validations, (k,)."""
    figures: Floats
    """Results of the k validations, (2, k): first row success rate, 0 to 1; second row cost of transport.

    The cost of transport is NaN if it was not recorded.
    """


@dataclass(frozen=True)
class SeedBand:
    """Group of training runs with the same settings and different seeds, made by `group_by_seed`."""

    label: str
    """Label of the group in the legend of the plot."""
    runs: tuple[RunCurve, ...]
    """Learning curves of the training runs, one for each seed."""

    @property
    def steps(self) -> Floats:
        """Numbers of training steps, (k,), at which all training runs of the group were validated."""
        return reduce(np.intersect1d, [run.steps for run in self.runs])

    def over_seeds(self) -> tuple[Floats, Floats, Floats]:
        """Compute mean, minimum and maximum over the seeds, at the common validations of all training runs.

        Returns:
            Three arrays, mean, minimum and maximum, each (2, k) for the k numbers of training steps in `steps`. The
            first row is the success rate, 0 to 1; the second row is the cost of transport.
        """
        figures = np.array([run.figures[:, np.isin(run.steps, self.steps)] for run in self.runs])
        return figures.mean(axis=0), figures.min(axis=0), figures.max(axis=0)


def read_curve(folder: Path) -> RunCurve:
    """Read the learning curve of a training run, which may be of an older version of this project.

    Args:
        folder: Folder of the training run.

    Returns:
        The learning curve; its arrays are empty if the training run has no validation yet.

    Raises:
        UsageError: The folder contains no training run, or the file of the validations is damaged.
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
    """Group the training runs that differ only in their seed.

    Args:
        runs: Learning curves of all training runs.

    Returns:
        One group for each combination of settings, with a label for the legend.

    Raises:
        UsageError: Two training runs of a group have the same seed.
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
    """Return the label of a group of training runs, for example `base trot (5 seeds)`.

    If the values of the options are too long, the label has the folder of the first training run instead.

    Args:
        runs: Learning curves of the group.
        options: Names of the options that the label shows with their values.

    Returns:
        The label.
    """
    settings = ", ".join(f"{name} {to_words(runs[0].settings.get(name))}" for name in options)
    seeds = f"{len(runs)} seeds" if len(runs) > 1 else f"seed {runs[0].seed}"
    return f"{settings if len(settings) <= MAX_LABEL_LENGTH else runs[0].folder} ({seeds})"


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
    mean, low, high = (PANELS[row][1] * figures[row] for figures in band.over_seeds())
    axes.fill_between(band.steps, low, high, color=colour, alpha=0.18, linewidth=0)
    for run in band.runs if len(band.runs) > 1 else ():
        axes.plot(run.steps, PANELS[row][1] * run.figures[row], color=colour, alpha=0.4, linewidth=0.7)
    axes.plot(band.steps, mean, f"{mark}-", color=colour, linewidth=1.6, markersize=4, label=band.label)
