"""Plot of the causes of failure: a bar for each disturbance axis, divided into the causes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from evaluate.causes.rules import CAUSES
from evaluate.report.plots.drawing import WIDTH, Margins, make_figure, short_name, text_width

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (
    *("#0072B2", "#56B4E9", "#D55E00", "#E69F00", "#F0E442", "#CC79A7"),
    *("#882255", "#009E73", "#999999", "#555555", "#000000", "#DDDDDD"),
)
"""Colours of the causes of failure, in the order of CAUSES."""
COLOURS = dict(zip(CAUSES, _COLOURS, strict=True))
"""Cause of failure -> colour of its segments in the bars.

The colours are from the palette of Okabe and Ito, one from Tol, and greys; colour-blind readers can distinguish them.
Segments that are long enough also show the name of their cause.
"""
ROW_HEIGHT = 0.19
"""Height of a bar in the plot of causes of failure, including the gap to the next bar, inches."""
LABEL_SIZE = 6.5
"""Font size of the labels in a bar of the plot of causes of failure, pt."""


def draw_cause_bars(policy: str, shares: Mapping[str, Mapping[str, float]]) -> "Figure":
    """Draw the causes of failure of one policy.

    Args:
        policy: Name of the policy.
        shares: Name of a disturbance axis -> cause -> episodes that failed from this cause, in % of the episodes of the
            policy on the axis.

    Returns:
        The matplotlib figure.
    """
    margins = Margins(left=0.15 + max(map(text_width, shares)), bottom=0.42, top=0.28)
    figure, axes = make_figure(ROW_HEIGHT * len(shares) + margins.top + margins.bottom, margins=margins)
    width = WIDTH - margins.left - margins.right
    for row, causes in enumerate(shares.values()):
        start = 0.0
        for cause, share in causes.items():
            axes.barh(row, share, left=start, color=COLOURS[cause], height=0.85, edgecolor="white", linewidth=0.5)
            label = cause.replace("_", " ")
            is_dark = int(COLOURS[cause][3:5], 16) < 0x80
            if text_width(label, LABEL_SIZE) < width * share / 100.0 - 0.04:
                axes.text(
                    start + share / 2, row, label, ha="center", va="center",
                    color="white" if is_dark else "black", fontsize=LABEL_SIZE,
                )  # fmt: skip
            start += share
    axes.set_yticks(range(len(shares)), list(shares))
    axes.set(xlim=(0.0, 100.0), ylim=(len(shares) - 0.5, -0.5), xlabel="failed episodes, %", title=short_name(policy))
    axes.tick_params(left=False)
    axes.grid(visible=False, axis="y")
    return figure
