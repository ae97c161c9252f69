"""Plots of the report, each a small SVG that fits a phone's width."""

import io
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

import numpy as np

from evaluate.experiment import Cell
from evaluate.results import Results
from evaluate.statistics import Floats, Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart by colour-blind readers and in grey print; each with a mark of its own.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
MARKS = ("o", "s", "^", "D", "v", "P", "X")
WIDTH = 3.6
"""in, about a phone's width at 100 points an inch"""
SHOWN = 600
"""Points that a scatter plot shows at most: the first of the run, the same for every policy."""

LONGEST_NAME = 20
"""Letters of a policy's name in a plot"""

AXES = (("forward", "m/s"), ("lateral", "m/s"), ("yaw rate", "rad/s"))


def settings() -> AbstractContextManager[None]:
    """Matplotlib's settings while plots are made; a fixed salt makes the same results give the same file."""
    import matplotlib

    return matplotlib.rc_context({"svg.hashsalt": "simple-quad", "font.size": 9, "axes.titleweight": "bold"})


def intervals(results: Results, scenario: str, metric: str, label: str, scale: float = 1.0) -> bytes:
    """A policy a line: figure and 95 % interval."""
    figure, axes = _figure(0.75 + 0.3 * len(results.policies))
    names = [policy for policy in results.policies if (scenario, policy) in results.summaries]
    for row, policy in enumerate(names):
        summary = results.summaries[scenario, policy]
        value, ci = scale * getattr(summary, metric), _scaled(getattr(summary, f"{metric}_ci"), scale)
        colour, mark = style(results, policy)
        if np.isfinite(ci).all():
            axes.plot(ci, (row, row), color=colour, linewidth=2.2, solid_capstyle="butt", alpha=0.55)
        axes.plot([value], [row], mark, color=colour, markersize=5.5)
    axes.set_yticks(range(len(names)), [short(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]) if scale == 1.0 else -2.0, right=None if scale == 1.0 else 102.0)
    axes.set_xlabel(label)
    axes.set_title(scenario, loc="left")
    return _svg(figure)


def paired(results: Results, scenario: str, policy: str, baseline: str) -> bytes:
    """An episode a point: the baseline's velocity error across, the policy's up; below the line it did better."""
    figure, axes = _figure(WIDTH)
    across, up = _cell(results, scenario, baseline), _cell(results, scenario, policy)
    colour, mark = style(results, policy)
    x, y = across.measures.velocity_error[:SHOWN], up.measures.velocity_error[:SHOWN]
    limit = 1.05 * float(max(x.max(), y.max(), 0.1))
    axes.plot((0, limit), (0, limit), color="#888888", linewidth=1)
    _same_ticks(axes)
    axes.plot(x, y, mark, color=colour, markersize=3.5, alpha=0.6, markeredgewidth=0)
    axes.set(xlim=(0, limit), ylim=(0, limit), xlabel=f"{short(baseline)}, m/s", ylabel=f"{short(policy)}, m/s")
    axes.set_title(scenario, loc="left")
    axes.set_aspect("equal")
    return _svg(figure)


def response(results: Results, scenario: str, policy: str, axis: int) -> bytes:
    """A command interval a point: commanded speed across, mean speed up; on the line it did as told."""
    figure, axes = _figure(WIDTH * 0.8)
    measures = _cell(results, scenario, policy).measures
    commanded = measures.commands[..., axis].ravel()[:SHOWN]
    achieved = measures.mean_velocities[..., axis].ravel()[:SHOWN]
    colour, mark = style(results, policy)
    name, unit = AXES[axis]
    limit = 1.08 * float(max(*np.abs(np.nan_to_num((commanded, achieved))).max(axis=1), 0.1))
    axes.plot((-limit, limit), (-limit, limit), color="#888888", linewidth=1)
    _same_ticks(axes)
    axes.plot(commanded, achieved, mark, color=colour, markersize=3.5, alpha=0.6, markeredgewidth=0)
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel=f"commanded {name}, {unit}", ylabel=f"mean, {unit}")
    axes.set_title(f"{short(policy)}: {name}", loc="left")
    axes.set_aspect("equal")
    return _svg(figure)


def short(policy: str) -> str:
    """A policy's name, or the end of a long path, as a plot has room for it."""
    return policy if len(policy) <= LONGEST_NAME else f"…{policy[1 - LONGEST_NAME :]}"


def stands_on(results: Results, scenario: str, policy: str) -> bool:
    """Whether a policy ended any command interval upright, and so has a response to show."""
    present = (scenario, policy) in results.summaries
    return present and bool(np.isfinite(_cell(results, scenario, policy).measures.mean_velocities).any())


def style(results: Results, policy: str) -> tuple[str, str]:
    """Colour and mark of a policy, the same in every plot."""
    index = results.policies.index(policy)
    return COLOURS[index % len(COLOURS)], MARKS[index % len(MARKS)]


def _cell(results: Results, scenario: str, policy: str) -> Cell:
    return next(cell for cell in results.cells if (cell.scenario.name, cell.policy) == (scenario, policy))


def _scaled(ci: Interval, scale: float) -> Floats:
    return scale * np.asarray(ci)


def _figure(height: float) -> "tuple[Figure, Axes]":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    return figure, axes


def _same_ticks(axes: "Axes") -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(5))


def _svg(figure: "Figure") -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    return buffer.getvalue()
