"""Learning curves: validations of training runs, those that differ in their seed alone together, and their picture."""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evaluate.report.plots.drawing import COLOURS, MARKS, settings
from policies.base import Floats
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import LARGEST, read_bytes
from quad_env.files.writing import write_atomically
from train.run_folder import VALIDATIONS_FILE
from train.run_record import flat, load_settings, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LONGEST = 48
"""Characters of a label."""


@dataclass(frozen=True)
class RunCurve:
    """k validations of one run."""

    folder: Path
    settings: Mapping[str, Any]
    """All settings but the seed, by the names of their options."""
    seed: int
    steps: Floats
    """(k,)"""
    figures: Floats
    """Success, share, and cost of transport, NaN where it was not recorded, (2, k)."""


@dataclass(frozen=True)
class SeedBand:
    """Runs of the same settings with different seeds."""

    label: str
    runs: tuple[RunCurve, ...]

    @property
    def steps(self) -> Floats:
        """Steps at which all of the runs were validated, (k,)."""
        return reduce(np.intersect1d, [run.steps for run in self.runs])

    def over_seeds(self) -> tuple[Floats, Floats, Floats]:
        """Mean, lowest and highest of the seeds' figures, each (2, k)."""
        figures = np.array([run.figures[:, np.isin(run.steps, self.steps)] for run in self.runs])
        return figures.mean(axis=0), figures.min(axis=0), figures.max(axis=0)


def read_curve(folder: Path) -> RunCurve:
    """The validations of the run in a folder, of older versions too. Raises UsageError where there is no run."""
    settings, path = dict(flat(load_settings(folder))), folder / VALIDATIONS_FILE
    try:
        entries = json.loads(read_bytes(path, LARGEST))["validations"] if path.exists() else []
        rows = {each["steps"]: (each["steps"], each["success"], each.get("cost_of_transport")) for each in entries}
        columns = np.array(list(rows.values()), np.float64).reshape(-1, 3).T
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(f"{path} holds no validations of a training run: leave that run out") from None
    return RunCurve(folder, settings, settings.pop("seed", 0), columns[0], columns[1:])


def by_seed(runs: Sequence[RunCurve]) -> list[SeedBand]:
    """The runs, those that differ in their seed alone together. Raises UsageError for a seed given twice."""
    groups = dict[str, list[RunCurve]]()
    for run in runs:
        same = groups.setdefault(json.dumps(run.settings, sort_keys=True), [])
        if twice := [each for each in same if each.seed == run.seed]:
            raise UsageError(f"{twice[0].folder} and {run.folder} are both seed {run.seed} of one recipe: name one")
        same.append(run)
    recipes = [each[0].settings for each in groups.values()]
    differ = [name for name in recipes[0] if any(each.get(name) != recipes[0][name] for each in recipes)]
    return [SeedBand(_label(each, differ or ["policy", "base"]), tuple(each)) for each in groups.values()]


def _label(runs: Sequence[RunCurve], options: Sequence[str]) -> str:
    """These settings of the runs, or where that is too long the first one's folder; and how many seeds."""
    said = ", ".join(f"{name} {words(runs[0].settings.get(name))}" for name in options)
    seeds = f"{len(runs)} seeds" if len(runs) > 1 else f"seed {runs[0].seed}"
    return f"{said if len(said) <= LONGEST else runs[0].folder} ({seeds})"


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
