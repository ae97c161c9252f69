"""What all plots of the report share: size, colours, marks, SVG."""

import io
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from evaluate.analysis.results import Results
from evaluate.rollouts.experiment import Cell

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart by colour-blind readers and in grey print; each with a mark of its own.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
MARKS = {"o": "●", "s": "■", "^": "▲", "D": "◆", "v": "▼", "P": "✚", "X": "✖"}
"""Matplotlib's name -> the same mark in text."""
WIDTH = 3.6
"""in, about a phone's width at 100 points an inch"""
LONGEST_NAME = 20
"""Letters of a policy's name in a plot"""


def settings() -> AbstractContextManager[None]:
    """Matplotlib's settings while plots are made; a fixed salt makes the same results give the same file.

    Text is left to the browser's fonts, which keeps the page small and its plots searchable.
    """
    import matplotlib

    return matplotlib.rc_context(
        {
            "svg.hashsalt": "simple-quad",
            "svg.fonttype": "none",
            "font.sans-serif": ["DejaVu Sans"],
            "font.size": 9,
            "axes.titleweight": "bold",
            "axes.titlesize": 10,
            "axes.titlelocation": "left",
        }
    )


@dataclass(frozen=True)
class Margins:
    """Room around a pair of axes, in; fixed, since a search for it draws every plot twice."""

    left: float = 0.55
    right: float = 0.12
    bottom: float = 0.48
    top: float = 0.12


def figure(
    height: float, width: float = WIDTH, margins: Margins = Margins(), projection: str = "rectilinear"
) -> "tuple[Figure, Axes]":
    """One pair of axes of that size, in."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(width, height))
    room = margins.left + margins.right, margins.bottom + margins.top
    place = margins.left / width, margins.bottom / height, 1.0 - room[0] / width, 1.0 - room[1] / height
    axes: Axes = drawn.add_axes(place, projection=projection)
    if projection == "rectilinear":
        axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    return drawn, axes


def svg(drawn: "Figure") -> bytes:
    """The figure as it goes into the page."""
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    return buffer.getvalue()


def style(results: Results, policy: str) -> tuple[str, str]:
    """Colour and matplotlib's mark of a policy, the same in every plot."""
    index = results.policies.index(policy)
    return COLOURS[index % len(COLOURS)], list(MARKS)[index % len(MARKS)]


def short_name(policy: str) -> str:
    """A policy's name, or the end of a long path, as a plot has room for it."""
    return policy if len(policy) <= LONGEST_NAME else f"…{policy[1 - LONGEST_NAME :]}"


def cell_of(results: Results, scenario: str, policy: str) -> Cell | None:
    """The cell of that name; None if an interrupted run lacks it."""
    found = (cell for cell in results.cells if (cell.scenario.name, cell.policy) == (scenario, policy))
    return next(found, None)


def same_ticks(axes: "Axes") -> None:
    """As many ticks up as across."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(5))
