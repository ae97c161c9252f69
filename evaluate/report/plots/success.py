"""Heat map of success by policy and axis."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from evaluate.analysis.score import Score
from evaluate.report.plots.drawing import Margins, make_figure, text_width
from quad_env.cli.format import break_name, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW, COLUMN, GAP, APART = 0.22, 0.3, 0.24, 0.12
"""Height and width of a cell of the heat map, room between two policies, and before the hardware profile, in."""
NAME_WIDTH, NAME_SIZE, NAME_LINE = 12, 8.0, 0.135
"""Characters of a policy's name in a line above its block, its size, pt, and the height of a line, in."""


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
    names = list(dict.fromkeys(name for part in parts for axes in part.values() for name in axes))
    policies = list(dict.fromkeys(policy for part in parts for policy in part))
    heads = ["\n".join(break_name(policy, NAME_WIDTH)) for policy in policies]
    counts = [max(len(rates) for axes in part.values() for rates in axes.values()) for part in parts]
    block = sum(counts) * COLUMN + (len(parts) - 1) * APART
    widest = max(text_width(line, NAME_SIZE, "bold") for head in heads for line in head.splitlines())
    width = max(block, widest) + GAP
    top = 0.15 + NAME_LINE * max(len(head.splitlines()) for head in heads)
    margins = Margins(left=0.15 + max(map(text_width, names)), right=0.05, bottom=0.06, top=top)
    size = len(policies) * width + margins.left + margins.right, len(names) * ROW + margins.top + margins.bottom
    drawn, axes = make_figure(size[1], size[0], margins)
    for place, (head, policy) in enumerate(zip(heads, policies, strict=True)):
        centre = (place + 0.5) * width
        left = centre - block / 2
        for part, count in zip(parts, counts, strict=True):
            for axis, rates in part.get(policy, {}).items():
                for column, rate in enumerate(rates):
                    _cell(axes, left + column * COLUMN, names.index(axis), rate)
            left += count * COLUMN + APART
        axes.text(centre, -0.35, head, ha="center", va="bottom", fontsize=NAME_SIZE, fontweight="bold")
    axes.set(xlim=(0.0, len(policies) * width), ylim=(len(names), 0.0), xticks=[])
    axes.set_yticks(np.arange(len(names)) + 0.5, names)
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    return drawn


def _cell(axes: "Axes", left: float, top: float, rate: float) -> None:
    """Draw one cell with its rate in per cent."""
    from matplotlib import colormaps
    from matplotlib.patches import Rectangle

    colour, ink = colormaps["cividis"](rate), "black" if rate > 0.5 else "white"
    axes.add_patch(Rectangle((left, top), COLUMN, 1.0, facecolor=colour, edgecolor="white"))
    axes.text(left + COLUMN / 2, top + 0.52, number(100.0 * rate, 0), ha="center", va="center", color=ink, fontsize=7)
