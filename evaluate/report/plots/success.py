"""Heat map of success by policy and axis."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from evaluate.analysis.score import Score
from evaluate.report.plots.drawing import Margins, make_figure, text_width
from quad_env.cli.format import break_name, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW_HEIGHT = 0.22
"""in. Height of a cell."""
COLUMN_WIDTH = 0.3
"""in. Width of a cell."""
POLICY_GAP = 0.24
"""in. Room between the blocks of two policies."""
HARDWARE_GAP = 0.12
"""in. Room before the columns with the hardware profile."""
NAME_WIDTH = 12
"""Characters of a policy's name in one line above its block."""
NAME_SIZE = 8.0
"""pt. Font size of that name."""
NAME_LINE = 0.135
"""in. Height of a line of that name."""


def draw_heat_map(scores: Sequence[Score], hardware: Sequence[Score] = ()) -> "Figure":
    """Draw success in per cent: a row per axis, a block per policy, a column per severity.

    The mildest severity is on the left.

    Args:
        scores: Scores of the policies.
        hardware: Scores with the hardware profile, drawn apart on the right of each block.

    Returns:
        The figure.
    """
    parts = [{score.policy: score.axes for score in part} for part in (scores, hardware) if part]
    axis_names = list(dict.fromkeys(name for part in parts for axes in part.values() for name in axes))
    policies = list(dict.fromkeys(policy for part in parts for policy in part))
    heads = ["\n".join(break_name(policy, NAME_WIDTH)) for policy in policies]
    counts = [max(len(rates) for axes in part.values() for rates in axes.values()) for part in parts]
    block_width = sum(counts) * COLUMN_WIDTH + (len(parts) - 1) * HARDWARE_GAP
    policy_width = max(block_width, _max_head_width(heads)) + POLICY_GAP
    top = 0.15 + NAME_LINE * max(len(head.splitlines()) for head in heads)
    margins = Margins(left=0.15 + max(map(text_width, axis_names)), right=0.05, bottom=0.06, top=top)
    width = len(policies) * policy_width + margins.left + margins.right
    height = len(axis_names) * ROW_HEIGHT + margins.top + margins.bottom
    figure, axes = make_figure(height, width, margins)
    for index, (head, policy) in enumerate(zip(heads, policies, strict=True)):
        centre = (index + 0.5) * policy_width
        left = centre - block_width / 2
        for part, count in zip(parts, counts, strict=True):
            _draw_block(axes, left, axis_names, part.get(policy, {}))
            left += count * COLUMN_WIDTH + HARDWARE_GAP
        axes.text(centre, -0.35, head, ha="center", va="bottom", fontsize=NAME_SIZE, fontweight="bold")
    axes.set(xlim=(0.0, len(policies) * policy_width), ylim=(len(axis_names), 0.0), xticks=[])
    axes.set_yticks(np.arange(len(axis_names)) + 0.5, axis_names)
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    return figure


def _max_head_width(heads: Sequence[str]) -> float:
    """Return the width of the widest line of the policies' names, in."""
    return max(text_width(line, NAME_SIZE, "bold") for head in heads for line in head.splitlines())


def _draw_block(
    axes: "Axes", left: float, axis_names: Sequence[str], rates_by_axis: Mapping[str, Sequence[float]]
) -> None:
    """Draw the cells of one policy from that position on, in."""
    for name, rates in rates_by_axis.items():
        for column, rate in enumerate(rates):
            _draw_cell(axes, left + column * COLUMN_WIDTH, axis_names.index(name), rate)


def _draw_cell(axes: "Axes", left: float, top: float, rate: float) -> None:
    """Draw one cell with its rate in per cent."""
    from matplotlib import colormaps
    from matplotlib.patches import Rectangle

    colour = colormaps["cividis"](rate)
    ink = "black" if rate > 0.5 else "white"
    text = number(100.0 * rate, 0)
    axes.add_patch(Rectangle((left, top), COLUMN_WIDTH, 1.0, facecolor=colour, edgecolor="white"))
    axes.text(left + COLUMN_WIDTH / 2, top + 0.52, text, ha="center", va="center", color=ink, fontsize=7)
