"""Plot of success against cost of transport, with the Pareto front as steps."""

from typing import TYPE_CHECKING

import numpy as np

from evaluate.analysis.pareto import Pareto
from evaluate.report.plots.drawing import Margins, add_legend, legend_height, make_figure, short_name, styles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ALT = "Success against cost of transport of each policy, and the Pareto front"
"""Text for readers who do not see the plot."""
HEIGHT = 2.5
"""in. Height of the axes."""


def draw_pareto_front(found: Pareto, policies: tuple[str, ...]) -> "Figure":
    """Draw success against cost of transport; filled marks are on the front.

    Args:
        pareto: Points and front.
        policies: All policies of the run, which determine marks and colours.

    Returns:
        The figure.
    """
    drawn_points = [point for point in found.points if np.isfinite(point.cost)]
    legend = legend_height(len(drawn_points))
    drawn, axes = make_figure(HEIGHT + legend, margins=Margins(bottom=0.6 + legend))
    for point in drawn_points:
        colour, shape = styles(policies)[point.policy]
        middle = np.array([point.cost, 100.0 * point.success])
        ends = np.array([point.cost_ci, 100.0 * np.array(point.success_ci)])
        reach = np.where(np.isfinite(ends), np.abs(ends - middle[:, None]), 0.0)
        axes.errorbar(
            middle[0], middle[1], xerr=reach[:1].T, yerr=reach[1:].T, fmt=shape, color=colour, elinewidth=1.0,
            markerfacecolor=colour if point.policy in found.front else "white", label=short_name(point.policy),
        )  # fmt: skip
    steps = {point.policy: (point.cost, 100.0 * point.success) for point in drawn_points}
    corners = np.array([steps[policy] for policy in found.front]).reshape(-1, 2)
    right = axes.get_xlim()[1]
    axes.step([*corners[:, 0], right], [*corners[:, 1], *corners[-1:, 1]], where="post", color="#888888", linewidth=1.0)
    axes.set(xlabel="cost of transport", ylabel="success, %", ylim=(-3, 103))
    axes.set_xlim(right=right)
    add_legend(drawn)
    return drawn
