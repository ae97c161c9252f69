"""Heat map of success: a row for each axis (kind of disturbance), a block of columns for each policy.

A cell of the heat map shows the success of one policy at one severity of one axis.
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
"""Height of a cell of the heat map, in."""
COLUMN_WIDTH = 0.3
"""Width of a cell of the heat map, in."""
POLICY_GAP = 0.24
"""Distance between the blocks of two policies, in."""
HARDWARE_GAP = 0.12
"""Distance between the columns without and with the hardware profile, in."""
NAME_WIDTH = 12
"""Largest number of characters in a line of the policy name above a block."""
NAME_SIZE = 8.0
"""Font size of the policy name above a block, pt."""
NAME_LINE = 0.135
"""Height of a line of the policy name above a block, in."""


@dataclass(frozen=True)
class _Layout:
    """Contents of a heat map, and its dimensions in inches.

    A block has one part without the hardware profile and one part with it. A part without data is left out.
    """

    parts: tuple[Mapping[str, Mapping[str, Sequence[float]]], ...]
    """For each part: policy -> axis -> success rate at each severity, the mildest first."""
    counts: tuple[int, ...]
    """Number of columns of each part."""
    axis_names: tuple[str, ...]
    """Names of the axes, one for each row."""
    policies: tuple[str, ...]
    """Names of the policies, one for each block."""

    @property
    def heads(self) -> tuple[str, ...]:
        """Names of the policies, with line breaks, for the text above the blocks."""
        return tuple("\n".join(break_name(policy, NAME_WIDTH)) for policy in self.policies)

    @property
    def block_width(self) -> float:
        """Width of the block of one policy, in."""
        return sum(self.counts) * COLUMN_WIDTH + (len(self.parts) - 1) * HARDWARE_GAP

    @property
    def policy_width(self) -> float:
        """Distance between the centres of two blocks, in."""
        head_width = max(text_width(line, NAME_SIZE, "bold") for head in self.heads for line in head.splitlines())
        return max(self.block_width, head_width) + POLICY_GAP

    @property
    def margins(self) -> Margins:
        """Margins around the cells, in."""
        top = 0.15 + NAME_LINE * max(len(head.splitlines()) for head in self.heads)
        return Margins(left=0.15 + max(map(text_width, self.axis_names)), right=0.05, bottom=0.06, top=top)


def draw_heat_map(scores: Sequence[Score], hardware: Sequence[Score] = ()) -> "Figure":
    """Draw success in per cent: a row per axis, a block per policy, a column per severity.

    The mildest severity is on the left.

    Args:
        scores: Scores without the hardware profile.
        hardware: Scores with the hardware profile, drawn on the right of each block.

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
    """Collect the axes and policies of all parts, in the order of the scores."""
    rates = [{score.policy: score.axes for score in part} for part in parts]
    axis_names = dict.fromkeys(name for part in rates for axes in part.values() for name in axes)
    policies = dict.fromkeys(policy for part in rates for policy in part)
    counts = [max(len(values) for axes in part.values() for values in axes.values()) for part in rates]
    return _Layout(tuple(rates), tuple(counts), tuple(axis_names), tuple(policies))


def _draw_policy(axes: "Axes", layout: _Layout, index: int, policy: str) -> None:
    """Draw the name and the cells of one policy; `index` is the index of its block."""
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
    """Draw one part of the block of one policy; `left` is the position of its left edge, in."""
    for name, rates in rates_by_axis.items():
        for column, rate in enumerate(rates):
            _draw_cell(axes, left + column * COLUMN_WIDTH, axis_names.index(name), rate)


def _draw_cell(axes: "Axes", left: float, top: float, rate: float) -> None:
    """Draw one cell with its success rate in per cent."""
    from matplotlib import colormaps
    from matplotlib.patches import Rectangle

    colour = colormaps["cividis"](rate)
    ink = "black" if rate > 0.5 else "white"
    text = number(100.0 * rate, 0)
    axes.add_patch(Rectangle((left, top), COLUMN_WIDTH, 1.0, facecolor=colour, edgecolor="white"))
    axes.text(left + COLUMN_WIDTH / 2, top + 0.52, text, ha="center", va="center", color=ink, fontsize=7)
