"""`python -m evaluate plot RUN --kind KIND`: figures of a run, or of training runs, for a paper.

scores: the score of each policy. axes: success against the severity of each disturbance. pareto: score against cost of
transport. curves: learning curves; RUN is then one or more folders of training runs, and runs that differ only in their
seed are one curve. All figures show 95 % intervals.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from quad_env.cli.command_line import UsageError, make_folder_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from evaluate.analysis.learning_curves import SeedBand

MIN_LEVELS = 2
"""Smallest number of severities of a disturbance axis that make a line in the figure of the axes."""


@dataclass(frozen=True)
class PlotOptions:
    """Options of the command: folders, kind of the figure, and its file and width."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = (Path("results/evaluation"),)
    """Folder of an evaluation; for --kind curves, folders of training runs, for example runs/residual-*."""
    kind: Literal["scores", "axes", "pareto", "curves"] = "scores"
    """Figure to draw."""
    out: Path = Path("results/figure.pdf")
    """File to write, .pdf, .svg or .png; an existing file is replaced."""
    columns: Literal[1, 2] = 1
    """Text columns that the figure spans: 1 (3.5 inches) or 2 (7.16 inches)."""
    policies: tuple[str, ...] = ()
    """Policies or groups of training seeds to show; by default all."""


def main(options: PlotOptions) -> int:
    """Draw the figure that the `options` select, and print its file; return the exit code 0."""
    from evaluate.report.plots.paper import FORMATS, save_figure

    if options.out.suffix not in FORMATS:
        raise UsageError(f"--out: unknown format, got {options.out}; valid: {', '.join(FORMATS)}")
    draw = _learning_curves(options) if options.kind == "curves" else _results_figure(options)
    make_folder_of(options.out, "--out")
    save_figure(draw, options.out)
    print(options.out)
    return 0


def _results_figure(options: PlotOptions) -> "Callable[[], Figure]":
    """Return the function that draws the figure of an evaluation.

    Args:
        options: Options of the command.

    Returns:
        Function that returns the matplotlib figure.

    Raises:
        UsageError: The options name several folders, or the run has nothing to draw.
    """
    from evaluate.analysis.entries import list_entries
    from evaluate.analysis.severity_levels import severity_axes
    from evaluate.commands.stored_results import load_results, select_entries
    from evaluate.report.plots.paper import draw_axes, draw_pareto, draw_scores

    if len(options.runs) != 1:
        raise UsageError(f"--kind {options.kind}: one results folder, got {len(options.runs)}; valid: one folder")
    results = load_results(options.runs[0])
    entries = select_entries(list_entries(results), options.policies)
    if options.kind == "axes":
        axes = [axis for axis in severity_axes(results.cells) if len(axis.levels) >= MIN_LEVELS]
        single = [axis.name for axis in severity_axes(results.cells) if len(axis.levels) < MIN_LEVELS]
        if not axes:
            raise UsageError(
                f"--kind axes: {options.runs[0]} has no axis with {MIN_LEVELS} severities; valid: push:all"
            )
        if single:
            print(f"left out, with one severity each: {', '.join(single)}", file=sys.stderr)
        return partial(draw_axes, axes, entries, options.columns)
    pareto = results.pareto if results.scores else results.hardware_pareto
    if not pareto.points:
        raise UsageError(
            f"--kind {options.kind}: no policy of {options.runs[0]} ran every scenario, so none has a score"
        )
    if options.kind == "pareto":
        return partial(draw_pareto, entries, pareto.cost_on, options.columns)
    return partial(draw_scores, entries, options.columns)


def _learning_curves(options: PlotOptions) -> "Callable[[], Figure]":
    """Return the function that draws learning curves, after the last point of each curve is printed.

    Args:
        options: Options of the command.

    Returns:
        Function that returns the matplotlib figure.

    Raises:
        UsageError: No training run has a validation, or the options select policies.
    """
    from evaluate.analysis.learning_curves import read_bands
    from evaluate.report.plots.paper import draw_learning_curves

    if options.policies:
        raise UsageError("--policies: selects policies of an evaluation, got --kind curves; name the training runs")
    bands = read_bands(options.runs)
    _print_last_points(bands)
    return partial(draw_learning_curves, bands, options.columns)


def _print_last_points(bands: "Sequence[SeedBand]") -> None:
    """Print the success of each learning curve at its last common validation, with its interval over the seeds."""
    from quad_env.cli.format import share, with_count

    for band in bands:
        if not len(band.steps):
            print(f"{band.label}: no validation that all seeds have", file=sys.stderr)
            continue
        low, high = band.mean_interval()
        success = share(float(band.figures.mean(axis=0)[0, -1]), (float(low[0, -1]), float(high[0, -1])))
        print(f"{band.label}: success {success} after {with_count(int(band.steps[-1]), 'step')}")
