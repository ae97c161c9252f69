"""Paired scatter: an episode a point, the baseline across, the other policies up."""

from collections.abc import Sequence

from evaluate.analysis.results import Results
from evaluate.report.plots.drawing import figure, same_ticks, short_name, style, svg
from evaluate.rollouts.experiment import Cell

SHOWN = 300
"""Episodes at most: the first of the run, the same for every policy."""


def paired(results: Results, others: Sequence[Cell], baseline: Cell) -> bytes:
    """Velocity error of each episode; below the line a policy did better than the baseline."""
    drawn, axes = figure(3.6)
    x = baseline.measures.velocity_error[:SHOWN]
    ups = [cell.measures.velocity_error[:SHOWN] for cell in others]
    limit = 1.05 * float(max(0.1, x.max(), *(up.max() for up in ups)))
    axes.plot((0, limit), (0, limit), color="#888888", linewidth=1)
    same_ticks(axes)
    for cell, up in zip(others, ups, strict=True):
        colour, mark = style(results, cell.policy)
        axes.plot(x, up, mark, color=colour, markersize=3.5, alpha=0.55, markeredgewidth=0)
    axes.set(
        xlim=(0, limit), ylim=(0, limit), xlabel=f"{short_name(baseline.policy)}, m/s", ylabel="other policies, m/s"
    )
    return svg(drawn)
