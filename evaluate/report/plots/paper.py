"""Figures of a run for papers: scores, success along the axes, Pareto front, and learning curves of trainings.

The figures have the widths of one and of two text columns. Colours are the same as in the report.
"""

import math
import textwrap
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evaluate.analysis.entries import Entry, Statistic
from evaluate.analysis.learning_curves import SeedBand
from evaluate.analysis.pareto import ParetoPoint, find_pareto_front
from evaluate.analysis.severity_levels import SeverityAxis
from evaluate.report.plots.drawing import COLOURS, CURVE_PANELS, MARKS, plot_settings, short_name, styles, write_image
from evaluate.report.plots.pareto import draw_pareto_front

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTHS = {1: 3.5, 2: 7.16}
"""Number of text columns -> width of a figure, inches; the columns of IEEE journals."""
FONT_SIZE = 8.0
"""Font size of the texts of a figure, pt, in the final size of the figure."""
SMALL_SIZE = 7.0
"""Font size of tick labels and legends, pt."""
ROW_HEIGHT = 0.3
"""Height of the row of an entry in the figure of scores, inches."""
PANEL_HEIGHT = 1.5
"""Height of a panel of success along an axis or of a learning curve, inches."""
AXES_PER_ROW = {1: 2, 2: 4}
"""Number of text columns -> panels side by side in the figure of the axes."""
LABEL_WIDTH = 26
"""Largest number of characters in a line of the label below a panel of an axis."""
LEGEND_NAMES = {1: 2, 2: 4}
"""Number of text columns -> names side by side in a legend."""
FORMATS = (".pdf", ".svg", ".png")
"""Suffixes of the image files that `save_figure` writes."""


@contextmanager
def paper_settings() -> "Iterator[None]":
    """Provide a context with the matplotlib settings of figures for papers: font sizes, fonts embedded as TrueType."""
    import matplotlib

    settings: Any = {
        "font.size": FONT_SIZE,
        "axes.titlesize": FONT_SIZE,
        "axes.labelsize": FONT_SIZE,
        "xtick.labelsize": SMALL_SIZE,
        "ytick.labelsize": SMALL_SIZE,
        "legend.fontsize": SMALL_SIZE,
        "pdf.fonttype": 42,
    }
    with ExitStack() as stack:
        contexts: tuple[AbstractContextManager[None], ...] = (plot_settings(), matplotlib.rc_context(settings))
        for context in contexts:
            stack.enter_context(context)
        yield


def save_figure(draw: "Callable[[], Figure]", out: Path) -> None:
    """Draw a figure and write it to an image file; OSError is raised if the file cannot be written.

    Args:
        draw: Function that draws and returns the figure.
        out: File to write; its suffix is one of FORMATS.
    """
    with paper_settings():
        write_image(draw, out, dpi=300)


def draw_scores(entries: Sequence[Entry], columns: int) -> "Figure":
    """Draw the scores of the entries with their intervals, the highest first.

    Groups of training seeds have a second mark for their interquartile mean. If the run has scenarios with the hardware
    profile, the figure has a second panel with the scores on them.

    Args:
        entries: Policies and groups of training seeds; entries without any score are left out.
        columns: Number of text columns that the figure spans.

    Returns:
        The matplotlib figure.
    """
    scored = [entry for entry in entries if _is_known(entry.score) or _is_known(entry.hardware_score)]
    scored.sort(key=lambda entry: -(entry.score if _is_known(entry.score) else entry.hardware_score).value)
    panels = _score_panels(scored)
    shape = (len(panels), 1) if columns == 1 else (1, len(panels))
    figure, axes = _make_panels(shape, WIDTHS[columns], (ROW_HEIGHT * len(scored) + 0.55) * shape[0])
    for panel, (label, statistics) in zip(axes, panels.items(), strict=True):
        _draw_score_panel(panel, scored, statistics, styles(tuple(entry.name for entry in entries)))
        panel.set(xlabel=label, xlim=(0.0, 100.0), ylim=(len(scored) - 0.5, -0.5))
        panel.set_yticks(range(len(scored)), [_label(entry) for entry in scored])
        panel.grid(visible=False, axis="y")
        if columns == 2 and panel is not axes[0]:
            panel.tick_params(labelleft=False)
    if handles := _legend_handles(axes):
        figure.legend(handles.values(), handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _score_panels(entries: Sequence[Entry]) -> dict[str, list[tuple[Statistic, Statistic]]]:
    """Collect the contents of the panels of scores, without and with the hardware profile, as far as they are known.

    Args:
        entries: Policies and groups of training seeds.

    Returns:
        Label of the panel -> mean and interquartile mean of each entry, 0 … 1.
    """
    panels = {
        "score, %": [(entry.score, entry.interquartile_mean) for entry in entries],
        "score with the hardware profile, %": [
            (entry.hardware_score, entry.hardware_interquartile_mean) for entry in entries
        ],
    }
    return {label: statistics for label, statistics in panels.items() if any(_is_known(mean) for mean, _ in statistics)}


def _draw_score_panel(
    axes: "Axes",
    entries: Sequence[Entry],
    statistics: Sequence[tuple[Statistic, Statistic]],
    style: "dict[str, tuple[str, str]]",
) -> None:
    """Draw the mean and interval of each entry, and the interquartile mean of each group, on one panel.

    Args:
        axes: Panel.
        entries: Policies and groups of training seeds, from top to bottom.
        statistics: Mean and interquartile mean of each entry, 0 … 1.
        style: Name of an entry -> colour and mark.
    """
    has_groups = any(entry.is_group for entry in entries)
    is_first = True
    for row, (entry, (mean, middle)) in enumerate(zip(entries, statistics, strict=True)):
        if not _is_known(mean):
            continue
        colour, mark = style[entry.name]
        label = "mean" if has_groups and entry.is_group and is_first else None
        lower = 0.16 if entry.is_group else 0.0
        _draw_statistic(axes, mean, row - lower, colour, mark, label)
        if entry.is_group:
            label = "interquartile mean" if is_first else None
            is_first = False
            _draw_statistic(axes, middle, row + lower, colour, "|", label)


def _draw_statistic(axes: "Axes", statistic: Statistic, row: float, colour: str, mark: str, label: str | None) -> None:
    """Draw a number, 0 … 1, with its interval as a horizontal bar in %, at the height `row`."""
    error = np.array([[statistic.value - statistic.ci[0]], [statistic.ci[1] - statistic.value]])
    axes.errorbar(
        [100.0 * statistic.value], [row], xerr=100.0 * np.nan_to_num(np.maximum(error, 0.0)), fmt=mark, color=colour,
        markersize=7 if mark == "|" else 4.5, markeredgewidth=1.8 if mark == "|" else 1.0, elinewidth=1.2,
        capsize=2.0, label=label,
    )  # fmt: skip


def draw_axes(axes: Sequence[SeverityAxis], entries: Sequence[Entry], columns: int) -> "Figure":
    """Draw success against severity, one panel for each disturbance axis, with bands between 95 % intervals.

    Args:
        axes: Disturbance axes with two or more severities.
        entries: Policies and groups of training seeds, one line each.
        columns: Number of text columns that the figure spans.

    Returns:
        The matplotlib figure.
    """
    across = min(AXES_PER_ROW[columns], len(axes))
    rows = math.ceil(len(axes) / across)
    legend = 0.17 * math.ceil(len(entries) / LEGEND_NAMES[columns]) + 0.1
    figure, panels = _make_panels((rows, across), WIDTHS[columns], PANEL_HEIGHT * rows + legend)
    style = styles(tuple(entry.name for entry in entries))
    for index, panel in enumerate(panels):
        if index >= len(axes):
            panel.set_visible(False)
            continue
        for entry in entries:
            _draw_levels(panel, axes[index], entry, style[entry.name], len(entries))
        panel.set(ylim=(-3.0, 103.0), yticks=(0, 50, 100))
        panel.set_title(axes[index].name, loc="left")
        panel.set_xlabel(textwrap.fill(axes[index].quantity, LABEL_WIDTH), fontsize=SMALL_SIZE)
        if index % across == 0:
            panel.set_ylabel("success, %")
        else:
            panel.tick_params(labelleft=False)
        if axes[index].is_harder_when_smaller:
            panel.invert_xaxis()
    handles = _legend_handles(panels)
    figure.legend(
        handles.values(), handles, loc="outside lower center", ncols=LEGEND_NAMES[columns], frameon=False,
        handletextpad=0.4, columnspacing=1.2,
    )  # fmt: skip
    return figure


def _legend_handles(panels: "Sequence[Axes]") -> "dict[str, Artist]":
    """Return the label of each line in some of the panels -> its handle for a legend."""
    handles: dict[str, Artist] = {}
    for panel in panels:
        artists, labels = panel.get_legend_handles_labels()
        handles |= dict(zip(labels, artists, strict=True))
    return handles


def _draw_levels(axes: "Axes", axis: SeverityAxis, entry: Entry, style: tuple[str, str], count: int) -> None:
    """Draw success of one entry against the severity of a disturbance axis, with the band of its intervals.

    Args:
        axes: Panel.
        axis: Disturbance axis.
        entry: Policy or group of training seeds.
        style: Colour and mark of the entry.
        count: Number of entries in the panel; bands of many entries are paler.
    """
    levels = [level for level in axis.levels if level.name in entry.success]
    if not levels:
        return
    severities = [level.severity for level in levels]
    statistics = [entry.success[level.name] for level in levels]
    low, high = 100.0 * np.array([statistic.ci for statistic in statistics]).T
    colour, mark = style
    axes.fill_between(severities, low, high, color=colour, alpha=min(0.18, 0.6 / count), linewidth=0)
    rates = [100.0 * statistic.value for statistic in statistics]
    axes.plot(severities, rates, f"{mark}-", color=colour, markersize=3, linewidth=1.1, label=_label(entry))


def draw_pareto(entries: Sequence[Entry], cost_on: str, columns: int) -> "Figure":
    """Draw score against cost of transport, with the Pareto front as a step line.

    Args:
        entries: Policies and groups of training seeds; entries without score or cost are left out.
        cost_on: Name of the scenario on which the cost is measured; empty for all scenarios together.
        columns: Number of text columns that the figure spans.

    Returns:
        The matplotlib figure.
    """
    points = []
    for entry in entries:
        score = entry.score if _is_known(entry.score) else entry.hardware_score
        if _is_known(score) and _is_known(entry.cost):
            points.append(ParetoPoint(_label(entry), score.value, score.ci, entry.cost.value, entry.cost.ci))
    pareto = find_pareto_front(cost_on, points)
    return draw_pareto_front(pareto, tuple(_label(entry) for entry in entries), WIDTHS[columns])


def draw_learning_curves(bands: Sequence[SeedBand], columns: int) -> "Figure":
    """Draw learning curves: mean over the training seeds, 95 % interval as a band, and each seed as a thin line.

    Args:
        bands: Groups of training runs that differ only in their seed.
        columns: Number of text columns that the figure spans.

    Returns:
        The matplotlib figure.
    """
    has_cost = any(np.isfinite(run.figures[1]).any() for band in bands for run in band.runs)
    panels = CURVE_PANELS[: 1 + has_cost]
    shape = (len(panels), 1) if columns == 1 else (1, len(panels))
    figure, axes = _make_panels(shape, WIDTHS[columns], 1.3 * PANEL_HEIGHT * shape[0] + 0.17 * len(bands) + 0.25)
    for row, panel in enumerate(axes):
        for index, band in enumerate(bands):
            _draw_band(panel, band, row, index)
        panel.set_ylabel(panels[row][0])
    axes[0].set_ylim(-3.0, 103.0)
    _label_steps(axes, is_stacked=columns == 1)
    has_bands = any(len(band.runs) > 1 for band in bands)
    note = "mean of the training seeds, 95 % interval" if has_bands else None
    handles = _legend_handles(axes[:1])
    figure.legend(
        handles.values(), handles, loc="outside lower center", frameon=False, title=note, title_fontsize=SMALL_SIZE
    )
    return figure


def _label_steps(panels: "Sequence[Axes]", *, is_stacked: bool) -> None:
    """Label the horizontal axes of learning curves, with numbers such as 2M; of stacked panels, only the lowest."""
    from matplotlib.ticker import EngFormatter

    for panel in panels:
        panel.xaxis.set_major_formatter(EngFormatter(sep=""))
        if is_stacked and panel is not panels[-1]:
            panel.tick_params(labelbottom=False)
        else:
            panel.set_xlabel("training steps")


def _draw_band(axes: "Axes", band: SeedBand, row: int, index: int) -> None:
    """Draw one group of training runs on a panel.

    Args:
        axes: Panel.
        band: Training runs that differ only in their seed.
        row: Index of the quantity: 0 for success, 1 for cost of transport.
        index: Index of the group; it determines colour and mark.
    """
    colour = COLOURS[index % len(COLOURS)]
    mark = [*MARKS][index % len(MARKS)]
    scale = CURVE_PANELS[row][1]
    low, high = band.mean_interval()
    if len(band.runs) > 1:
        axes.fill_between(band.steps, scale * low[row], scale * high[row], color=colour, alpha=0.2, linewidth=0)
        for run in band.runs:
            axes.plot(run.steps, scale * run.figures[row], color=colour, alpha=0.4, linewidth=0.6)
    mean = band.figures.mean(axis=0)[row]
    axes.plot(band.steps, scale * mean, f"{mark}-", color=colour, linewidth=1.3, markersize=3, label=band.label)


def _make_panels(shape: tuple[int, int], width: float, height: float) -> "tuple[Figure, list[Axes]]":
    """Make a figure with a grid of panels.

    Args:
        shape: Number of rows and of columns of the grid.
        width: Width of the figure, inches.
        height: Height of the figure, inches.

    Returns:
        The matplotlib figure and its panels, row by row.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    panels = [*figure.subplots(*shape, squeeze=False).ravel()]
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(color="#dddddd", linewidth=0.5)
        panel.set_axisbelow(True)
    return figure, panels


def _is_known(statistic: Statistic) -> bool:
    """Return True if a number is defined."""
    return math.isfinite(statistic.value)


def _label(entry: Entry) -> str:
    """Return the name of an entry, shortened, with the number of training seeds of a group."""
    return f"{short_name(entry.name)} ({len(entry.policies)} seeds)" if entry.is_group else short_name(entry.name)
