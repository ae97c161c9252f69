"""Common parts of the report's plots: size, colours, marks, SVG."""

import io
import re
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from evaluate.analysis.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#882255", "#8C8C1A")
"""Colours from Okabe and Ito, and two from Tol: distinct to colour-blind readers and, with the marks, in grey print."""
MARKS = {"o": "●", "s": "■", "^": "▲", "D": "◆", "v": "▼", "P": "✚", "X": "✖"}
"""Matplotlib's name of a mark -> the same mark in text."""
FIXED_STYLE_POLICIES = ("document", "document_repaired", "trot", "residual", "trot_feedback", "trot_integral", "robust")
"""Policies with the same colour in every report, the first of COLOURS; others get theirs by order."""
FONT = "DejaVu Sans"
"""Font for the measured width of texts."""
WIDTH = 3.6
"""in. Width of a plot: about a phone's at 100 points an inch."""
MAX_NAME_WIDTH = 1.5
"""in. Largest width of a policy's name in a plot."""
LEGEND_LINE = 0.17
"""in. Height of a line of a legend."""


def plot_settings() -> AbstractContextManager[None]:
    """Apply matplotlib's settings for all plots; a fixed salt gives equal files for equal results.

    Text is left to the browser's fonts, which keeps the page small and its plots searchable.
    """
    import matplotlib

    return matplotlib.rc_context(
        {
            "svg.hashsalt": "simple-quad",
            "svg.fonttype": "none",
            "font.sans-serif": [FONT],
            "font.size": 9,
            "axes.titleweight": "bold",
            "axes.titlesize": 10,
            "axes.titlelocation": "left",
        }
    )


@dataclass(frozen=True)
class Margins:
    """Margins around the axes of a plot, in; fixed, because a search for them would draw every plot twice."""

    left: float = 0.62
    right: float = 0.18
    bottom: float = 0.48
    top: float = 0.12


def make_figure(height: float, width: float = WIDTH, margins: Margins = Margins()) -> "tuple[Figure, Axes]":
    """Create a figure with one pair of axes.

    Args:
        height: Height, in.
        width: Width, in.
        margins: Margins around the axes, in.

    Returns:
        Figure and axes.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    axes = figure.add_axes(
        (
            margins.left / width,
            margins.bottom / height,
            1.0 - (margins.left + margins.right) / width,
            1.0 - (margins.bottom + margins.top) / height,
        )
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    return figure, axes


def figure_to_svg(figure: "Figure") -> bytes:
    """Return the figure as SVG for the page."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    return buffer.getvalue()


@cache
def styles(policies: tuple[str, ...]) -> dict[str, tuple[str, str]]:
    """Assign a colour and a mark to each policy.

    FIXED_STYLE_POLICIES have the first colours, other policies the remaining ones, and further policies all colours
    again with other marks.
    """
    others = [policy for policy in policies if policy not in FIXED_STYLE_POLICIES]
    indices = {policy: FIXED_STYLE_POLICIES.index(policy) for policy in policies if policy in FIXED_STYLE_POLICIES}
    indices |= {policy: len(FIXED_STYLE_POLICIES) + number for number, policy in enumerate(others)}
    marks = list(MARKS)
    return {
        policy: (COLOURS[index % len(COLOURS)], marks[sum(divmod(index, len(COLOURS))) % len(marks)])
        for policy, index in indices.items()
    }


def style(results: Results, policy: str) -> tuple[str, str]:
    """Return colour and matplotlib mark of a `policy` of the `results`, the same in every plot."""
    return styles(results.policies)[policy]


@cache
def text_width(text: str, size: float = 9.0, weight: str = "normal") -> float:
    """Compute the width of a text in a plot.

    Args:
        text: Text.
        size: Font size, pt.
        weight: Font weight.

    Returns:
        Width, in.
    """
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = TextPath((0.0, 0.0), text, size, prop=FontProperties(family=FONT, weight=weight))
    return float(path.get_extents().width) / 72.0


def short_name(policy: str) -> str:
    """Return the name of a policy, or the end of a long path that fits into a plot."""
    word_ends = [match.end() for match in re.finditer(r"[/_\-:@+]", policy) if match.end() < len(policy)]
    starts = (*word_ends, *range(1, len(policy)))
    candidates = (policy, *(f"…{policy[start:]}" for start in starts))
    return next((name for name in candidates if text_width(name) <= MAX_NAME_WIDTH), "…")


def legend_height(names: int) -> float:
    """Return the height of a legend of that many names below the axes, in."""
    return LEGEND_LINE * -(-names // 2)


def add_legend(figure: "Figure") -> None:
    """Add a legend of the policies below the axes, two in a line; figures leave `legend_height` for it."""
    figure.legend(
        loc="lower left", ncols=2, fontsize=7.5, frameon=False, handletextpad=0.2,
        columnspacing=1.0, borderpad=0.0, labelspacing=0.35,
    )  # fmt: skip
