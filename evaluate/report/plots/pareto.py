"""Plot of success against cost of transport of the policies, with the Pareto front as a step line."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evaluate.analysis.pareto import Pareto, ParetoPoint
from evaluate.report.plots.drawing import WIDTH, Margins, add_legend, legend_height, make_figure, short_name, styles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ALT = "Success against cost of transport of each policy, and the Pareto front"
"""Alternative text of the plot for screen readers."""
HEIGHT = 2.5
"""Height of the plot of success against cost of transport, without its legend, inches."""


def draw_pareto_front(pareto: Pareto, policies: tuple[str, ...], width: float = WIDTH) -> "Figure":
    """Draw success against cost of transport; policies on the Pareto front have filled marks.

    Args:
        pareto: Points of the policies (cost of transport and success), and the Pareto front.
        policies: Names of all policies of the run; they determine marks and colours.
        width: Width of the figure, inches.

    Returns:
        The matplotlib figure.
    """
    points = {point.policy: point for point in pareto.points if np.isfinite(point.cost)}
    legend = legend_height(len(points))
    figure, axes = make_figure(HEIGHT + legend, width, Margins(bottom=0.6 + legend))
    for point in points.values():
        _draw_point(axes, point, styles(policies)[point.policy], is_on_front=point.policy in pareto.front)
    corners = [(points[policy].cost, 100.0 * points[policy].success) for policy in pareto.front]
    right = axes.get_xlim()[1]
    _draw_steps(axes, corners, right)
    axes.set(xlabel="cost of transport", ylabel="success, %", ylim=(-3, 103))
    axes.set_xlim(right=right)
    add_legend(figure)
    return figure


def _draw_point(axes: "Axes", point: ParetoPoint, style: tuple[str, str], *, is_on_front: bool) -> None:
    """Draw the mark of a policy with the intervals of success and cost of transport.

    `style` is the colour and the matplotlib mark. The mark is filled if `is_on_front`, that is, if the policy is on the
    Pareto front.
    """
    colour, mark = style
    cost = np.array([point.cost])
    success = np.array([100.0 * point.success])
    axes.errorbar(
        cost, success, xerr=_error_bar(point.cost, point.cost_ci),
        yerr=_error_bar(100.0 * point.success, 100.0 * np.array(point.success_ci)),
        fmt=mark, color=colour, elinewidth=1.0, markerfacecolor=colour if is_on_front else "white",
        label=short_name(point.policy),
    )  # fmt: skip


def _error_bar(value: float, interval: ArrayLike) -> NDArray[np.float64]:
    """Return the distances from `value` to the ends of its `interval`, (2, 1), for a matplotlib error bar.

    The distance to an end that is not finite is 0.
    """
    ends = np.asarray(interval, np.float64)
    return np.where(np.isfinite(ends), np.abs(ends - value), 0.0)[:, None]


def _draw_steps(axes: "Axes", corners: Sequence[tuple[float, float]], right: float) -> None:
    """Draw the Pareto front as a step line through the `corners`, up to the `right` end of the plot.

    A corner is cost of transport and success of a policy on the front. `right` is a cost of transport as well.
    """
    costs = [*(cost for cost, _ in corners), right]
    successes = [*(success for _, success in corners), *(success for _, success in corners[-1:])]
    axes.step(costs, successes, where="post", color="#888888", linewidth=1.0)
