"""What all plots of the report share: size, colours, marks, SVG."""

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
"""Okabe and Ito's, and two of Tol's: distinct to colour-blind readers and, with the marks, in grey print."""
MARKS = {"o": "●", "s": "■", "^": "▲", "D": "◆", "v": "▼", "P": "✚", "X": "✖"}
"""Matplotlib's name -> the same mark in text."""
FIXED_STYLE_POLICIES = ("document", "document_repaired", "trot", "residual", "trot_feedback", "trot_integral", "robust")
"""Policies whose colours, the first of COLOURS, are the same in every report; those of others go by their order."""
FONT = "DejaVu Sans"
WIDTH = 3.6
"""in, about a phone's width at 100 points an inch"""
LONGEST_NAME = 1.5
"""in, of a policy's name in a plot"""
LEGEND_LINE = 0.17
"""in. Height of a line of a legend."""


def settings() -> AbstractContextManager[None]:
    """Matplotlib's settings while plots are made; a fixed salt makes the same results give the same file.

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
    """Room around a pair of axes, in; fixed, since a search for it draws every plot twice."""

    left: float = 0.62
    right: float = 0.18
    bottom: float = 0.48
    top: float = 0.12


def figure(height: float, width: float = WIDTH, margins: Margins = Margins()) -> "tuple[Figure, Axes]":
    """One pair of axes of that size, in."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(width, height))
    room = margins.left + margins.right, margins.bottom + margins.top
    place = margins.left / width, margins.bottom / height, 1.0 - room[0] / width, 1.0 - room[1] / height
    axes = drawn.add_axes(place)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    return drawn, axes


def svg(drawn: "Figure") -> bytes:
    """The figure as it goes into the page."""
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    return buffer.getvalue()


@cache
def styles(policies: tuple[str, ...]) -> dict[str, tuple[str, str]]:
    """Colours and marks: of OWN the first, of others those that are left, then all of them with other marks."""
    others = (policy for policy in policies if policy not in FIXED_STYLE_POLICIES)
    places = {policy: FIXED_STYLE_POLICIES.index(policy) for policy in policies if policy in FIXED_STYLE_POLICIES}
    places |= {policy: len(FIXED_STYLE_POLICIES) + number for number, policy in enumerate(others)}
    marks = list(MARKS)
    return {
        policy: (COLOURS[place % len(COLOURS)], marks[sum(divmod(place, len(COLOURS))) % len(marks)])
        for policy, place in places.items()
    }


def style(results: Results, policy: str) -> tuple[str, str]:
    """Colour and matplotlib's mark of a policy, the same in every plot."""
    return styles(results.policies)[policy]


@cache
def text_width(text: str, size: float = 9.0, weight: str = "normal") -> float:
    """Width of a text at a size in points, in."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    return (
        float(TextPath((0.0, 0.0), text, size, prop=FontProperties(family=FONT, weight=weight)).get_extents().width)
        / 72.0
    )


def short_name(policy: str) -> str:
    """A policy's name, or the end of a long path, as a plot has room for it."""
    words = [each.end() for each in re.finditer(r"[/_\-:@+]", policy) if each.end() < len(policy)]
    cuts = (policy, *(f"…{policy[first:]}" for first in (*words, *range(1, len(policy)))))
    return next((name for name in cuts if text_width(name) <= LONGEST_NAME), "…")


def legend_height(names: int) -> float:
    """Return the height of a legend of those names below the axes, in."""
    return LEGEND_LINE * -(-names // 2)


def add_legend(drawn: "Figure") -> None:
    """Name the policies below the axes, two in a line; figures leave `legend_height` for it."""
    drawn.legend(
        loc="lower left", ncols=2, fontsize=7.5, frameon=False, handletextpad=0.2,
        columnspacing=1.0, borderpad=0.0, labelspacing=0.35,
    )  # fmt: skip
