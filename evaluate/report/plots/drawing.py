"""Common parts of all plots of the report: size, colours, marks, legend, SVG."""

import io
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from evaluate.analysis.results import Results
from quad_env.files.writing import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#882255", "#8C8C1A")
"""Colours of the policies in plots, from the palette of Okabe and Ito, and two from Tol.

Colour-blind readers can distinguish the colours. If a report is printed in grey, the marks distinguish the policies.
"""
MARKS = {"o": "●", "s": "■", "^": "▲", "D": "◆", "v": "▼", "P": "✚", "X": "✖"}
"""Matplotlib name of the mark of a policy -> Unicode character of the same mark, for tables."""
FIXED_STYLE_POLICIES = ("document", "document_repaired", "trot", "residual", "trot_feedback", "trot_integral", "robust")
"""Names of policies that have the same colour in every report: the first colours in COLOURS, in this order."""
FONT = "DejaVu Sans"
"""Font with which the widths of texts in plots are measured."""
WIDTH = 3.6
"""Width of a plot, inches; at 100 points per inch it is about the width of a phone."""
MAX_NAME_WIDTH = 1.5
"""Largest width of the name of a policy in a plot, inches; longer names are shortened."""
LEGEND_LINE = 0.17
"""Height of a line of the legend of a plot, inches."""


DATE_METADATA = {".svg": "Date", ".png": "Creation Time", ".pdf": "CreationDate"}
"""Suffix of an image file -> metadata field with its date, which is left empty, so that equal runs give equal files."""
CURVE_PANELS = (("success in validation, %", 100.0), ("cost of transport", 1.0))
"""Panels of learning curves, from top to bottom.

Each item has the label of the vertical axis, and the factor that converts the data to the unit of the label."""


def plot_settings() -> AbstractContextManager[None]:
    """Return a context manager that applies the matplotlib settings of all plots.

    The hash salt of the SVG identifiers is fixed, so that equal results give equal files. Text is stored as text, not
    as outlines, because this keeps the page small and its plots searchable.
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
    """Margins around the axes of a plot, inches.

    The margins are fixed, because an automatic layout would draw every plot twice.
    """

    left: float = 0.62
    right: float = 0.18
    bottom: float = 0.48
    top: float = 0.12


def make_figure(height: float, width: float = WIDTH, margins: Margins = Margins()) -> "tuple[Figure, Axes]":
    """Create a matplotlib figure with one set of axes.

    Args:
        height: Height of the figure, inches.
        width: Width of the figure, inches.
        margins: Margins around the axes, inches.

    Returns:
        The matplotlib figure and its axes.
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
    """Return the contents of an SVG file with the figure, on a transparent background."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    return buffer.getvalue()


def write_image(draw: "Callable[[], Figure]", out: Path, dpi: int) -> None:
    """Draw a Matplotlib figure and write it to an image file.

    Raises OSError if the file cannot be written; an existing file is then unchanged.

    Args:
        draw: Function without arguments that draws and returns the figure.
        out: Image file to write; its suffix is a key of `DATE_METADATA`.
        dpi: Resolution of a PNG, and of pixels in other formats, 1/inch.
    """
    content = io.BytesIO()
    metadata = {DATE_METADATA[out.suffix]: None}
    draw().savefig(content, format=out.suffix[1:], dpi=dpi, facecolor="white", metadata=metadata)
    write_atomically(out, content.getvalue())


@cache
def styles(policies: tuple[str, ...]) -> dict[str, tuple[str, str]]:
    """Return the colour and the mark of each policy in plots: name of a policy -> colour, matplotlib mark.

    FIXED_STYLE_POLICIES have the first colours, and other policies have the remaining colours. If there are more
    policies than colours, the colours are used again with other marks.
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
    """Return the colour and the matplotlib mark of a `policy` in all plots of the `results`."""
    return styles(results.policies)[policy]


@cache
def text_width(text: str, size: float = 9.0, weight: str = "normal") -> float:
    """Compute the width of a text in a plot.

    Args:
        text: Text to measure.
        size: Font size, pt.
        weight: Font weight.

    Returns:
        Width of the text, inches.
    """
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = TextPath((0.0, 0.0), text, size, prop=FontProperties(family=FONT, weight=weight))
    return float(path.get_extents().width) / 72.0


def short_name(policy: str) -> str:
    """Return the name of a `policy`, shortened to `…` and its end if it is wider than MAX_NAME_WIDTH."""
    word_ends = [match.end() for match in re.finditer(r"[/_\-:@+]", policy) if match.end() < len(policy)]
    starts = (*word_ends, *range(1, len(policy)))
    candidates = (policy, *(f"…{policy[start:]}" for start in starts))
    return next((name for name in candidates if text_width(name) <= MAX_NAME_WIDTH), "…")


def legend_height(names: int) -> float:
    """Return the height of the legend with a number of `names`, two in each line, inches."""
    return LEGEND_LINE * -(-names // 2)


def add_legend(figure: "Figure") -> None:
    """Add a legend of the policies below the axes of the `figure`, two policies in each line.

    The figure must have free space at the bottom; its height is `legend_height`.
    """
    figure.legend(
        loc="lower left", ncols=2, fontsize=7.5, frameon=False, handletextpad=0.2,
        columnspacing=1.0, borderpad=0.0, labelspacing=0.35,
    )  # fmt: skip
