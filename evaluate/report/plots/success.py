"""Heat map of success: a row for each disturbance axis, a block of columns for each policy.

A cell of the heat map shows the success rate of one policy at one severity of one axis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from evaluate.analysis.score import Score
from evaluate.report.plots.drawing import Margins, make_figure, text_width
from quad_env.cli.format import break_name, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW_HEIGHT = 0.22
"""Height of a cell of the heat map of success rates, inches."""
COLUMN_WIDTH = 0.3
"""Width of a cell of the heat map of success rates, inches."""
POLICY_GAP = 0.24
"""Distance between the blocks (groups of columns) of two policies in the heat map, inches."""
HARDWARE_GAP = 0.12
"""Distance between the columns without and with the hardware profile in the heat map, inches."""
NAME_WIDTH = 12
"""Largest number of characters in a line of a policy name above the heat map of success rates."""
NAME_SIZE = 8.0
"""Font size of a policy name above the heat map of success rates, pt."""
NAME_LINE = 0.135
"""Height of a line of a policy name above the heat map of success rates, inches."""


@dataclass(frozen=True)
class _Layout:
    """Contents of the heat map of success, and its dimensions in inches.

    Each policy has a block of columns. A block has two parts: columns for scenarios without the hardware profile, and
    columns for scenarios with it. A part is left out if it has no data.
    """

    parts: tuple[Mapping[str, Mapping[str, Sequence[float]]], ...]
    """Success rates in each part of the heat map: policy -> disturbance axis -> rate at each severity.

    The first part is for scenarios without the hardware profile, the second part for scenarios with it. The mildest
    severity is first.
    """
    counts: tuple[int, ...]
    """Number of columns of each part of the heat map: the largest number of severities of an axis.

    The first part is for scenarios without the hardware profile, the second part for scenarios with it.
    """
    axis_names: tuple[str, ...]
    """Names of the disturbance axes, one for each row of the heat map."""
    policies: tuple[str, ...]
    """Names of the policies, one for each block (group of columns) of the heat map."""

    @property
    def heads(self) -> tuple[str, ...]:
        """Names of the policies with line breaks, for the text above the heat map."""
        return tuple("\n".join(break_name(policy, NAME_WIDTH)) for policy in self.policies)

    @property
    def block_width(self) -> float:
        """Width of the block (group of columns) of one policy in the heat map, inches."""
        return sum(self.counts) * COLUMN_WIDTH + (len(self.parts) - 1) * HARDWARE_GAP

    @property
    def policy_width(self) -> float:
        """Distance between the centres of two adjacent blocks (groups of columns) of the heat map, inches."""
        head_width = max(text_width(line, NAME_SIZE, "bold") for head in self.heads for line in head.splitlines())
        return max(self.block_width, head_width) + POLICY_GAP

    @property
    def margins(self) -> Margins:
        """Margins around the cells of the heat map, inches."""
        top = 0.15 + NAME_LINE * max(len(head.splitlines()) for head in self.heads)
        return Margins(left=0.15 + max(map(text_width, self.axis_names)), right=0.05, bottom=0.06, top=top)


def draw_heat_map(scores: Sequence[Score], hardware: Sequence[Score] = ()) -> "Figure":
    """Draw the success rates in %: a row per disturbance axis, a block per policy, a column per severity.

    The mildest severity is on the left.

    Args:
        scores: Scores of the policies without the hardware profile.
        hardware: Scores of the policies with the hardware profile, drawn on the right of each block.

    Returns:
        The matplotlib figure.
    """
    layout = _make_layout([part for part in (scores, hardware) if part])
    margins = layout.margins
    cells_width = len(layout.policies) * layout.policy_width
    height = len(layout.axis_names) * ROW_HEIGHT + margins.top + margins.bottom
    figure, axes = make_figure(height, cells_width + margins.left + margins.right, margins)
    for index, policy in enumerate(layout.policies):
        _draw_policy(axes, layout, index, policy)
    axes.set(xlim=(0.0, cells_width), ylim=(len(layout.axis_names), 0.0), xticks=[])
    axes.set_yticks(np.arange(len(layout.axis_names)) + 0.5, layout.axis_names)
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    return figure


def _make_layout(parts: Sequence[Sequence[Score]]) -> _Layout:
    """Collect the contents of the heat map from the scores of its `parts`, in the order of the scores.

    The parts are the scores without and with the hardware profile.
    """
    rates = [{score.policy: score.axes for score in part} for part in parts]
    axis_names = dict.fromkeys(name for part in rates for axes in part.values() for name in axes)
    policies = dict.fromkeys(policy for part in rates for policy in part)
    counts = [max(len(values) for axes in part.values() for values in axes.values()) for part in rates]
    return _Layout(tuple(rates), tuple(counts), tuple(axis_names), tuple(policies))


def _draw_policy(axes: "Axes", layout: _Layout, index: int, policy: str) -> None:
    """Draw the name and the cells of one `policy`; `index` is the index of its block of columns, from 0."""
    centre = (index + 0.5) * layout.policy_width
    left = centre - layout.block_width / 2
    for part, count in zip(layout.parts, layout.counts, strict=True):
        _draw_block(axes, left, layout.axis_names, part.get(policy, {}))
        left += count * COLUMN_WIDTH + HARDWARE_GAP
    head = layout.heads[index]
    axes.text(centre, -0.35, head, ha="center", va="bottom", fontsize=NAME_SIZE, fontweight="bold")


def _draw_block(
    axes: "Axes", left: float, axis_names: Sequence[str], rates_by_axis: Mapping[str, Sequence[float]]
) -> None:
    """Draw one part of the block of a policy: the cells without, or with, the hardware profile.

    `left` is the left edge of the cells, inches. `rates_by_axis` contains the success rates: disturbance axis -> rate
    at each severity, the mildest first.
    """
    for name, rates in rates_by_axis.items():
        for column, rate in enumerate(rates):
            _draw_cell(axes, left + column * COLUMN_WIDTH, axis_names.index(name), rate)


def _draw_cell(axes: "Axes", left: float, top: float, rate: float) -> None:
    """Draw one cell with its success `rate` in %; `left` and `top` are the cell's position, inches."""
    from matplotlib import colormaps
    from matplotlib.patches import Rectangle

    colour = colormaps["cividis"](rate)
    ink = "black" if rate > 0.5 else "white"
    text = number(100.0 * rate, 0)
    axes.add_patch(Rectangle((left, top), COLUMN_WIDTH, 1.0, facecolor=colour, edgecolor="white"))
    axes.text(left + COLUMN_WIDTH / 2, top + 0.52, text, ha="center", va="center", color=ink, fontsize=7)
