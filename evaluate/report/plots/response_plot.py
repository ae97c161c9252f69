"""Speed response: what a policy does of the speed it is told, and where it does next to nothing."""

import numpy as np

from evaluate.analysis.results import Results
from evaluate.measures.response import AXES, known
from evaluate.report.plots.drawing import Margins, cell_of, figure, same_ticks, style, svg
from evaluate.statistics.intervals import Floats

COMPONENTS = tuple((axis.replace("_", " "), unit) for axis, unit in AXES.items())
"""Component of a command, and its unit."""
BINS = 9
"""Bins of a component's commands."""
FEWEST = 3
"""Command intervals that a bin needs to be shown."""


def response(results: Results, scenario: str, component: int) -> bytes:
    """Mean speed against commanded speed, a line a policy; the band holds the middle half of the intervals."""
    name, unit = COMPONENTS[component]
    drawn, axes = figure(3.0, 3.2, Margins(left=0.75))
    limit = _largest(results, scenario, component)
    axes.plot((-limit, limit), (-limit, limit), color="#888888", linewidth=1)
    for policy in results.policies:
        colour, mark = style(results, policy)
        centre, low, middle, high = _quartiles(*intervals(results, scenario, policy, component), limit)
        if len(centre):
            axes.fill_between(centre, low, high, color=colour, alpha=0.15, linewidth=0)
            axes.plot(centre, middle, color=colour, marker=mark, markersize=4, linewidth=1.4)
    axes.set(xlim=(-1.05 * limit, 1.05 * limit), xlabel=f"commanded {name}, {unit}", ylabel=f"mean, {unit}")
    same_ticks(axes)
    return svg(drawn)


def intervals(results: Results, scenario: str, policy: str, component: int) -> tuple[Floats, Floats]:
    """Commanded and mean speed of the command intervals that the robot ended upright, both (k,)."""
    cell = cell_of(results, scenario, policy)
    if cell is None:
        return np.empty(0), np.empty(0)
    return known(cell.measures.commands, cell.measures.mean_velocities, component)


def _largest(results: Results, scenario: str, component: int) -> float:
    speeds = [intervals(results, scenario, policy, component)[0] for policy in results.policies]
    return float(max(np.abs(np.concatenate(speeds)).max(initial=0.0), 0.1))


def _quartiles(commanded: Floats, achieved: Floats, limit: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean command of each bin, and the quartiles of what came of it."""
    inner = np.linspace(-limit, limit, BINS + 1)[1:-1]
    where = np.digitize(commanded, inner)
    rows = [
        (commanded[where == k].mean(), *np.quantile(achieved[where == k], (0.25, 0.5, 0.75)))
        for k in range(BINS)
        if (where == k).sum() >= FEWEST
    ]
    centre, low, middle, high = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    return centre, low, middle, high
