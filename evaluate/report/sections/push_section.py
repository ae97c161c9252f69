"""Falls after pushes, by direction and impulse, of all the scenarios of an axis together."""

import numpy as np

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, amount
from evaluate.measures.pushes import FALL_WITHIN
from evaluate.report.html import grid, image, note
from evaluate.report.plots.drawing import Margins, cell_of, figure, short_name, svg
from evaluate.statistics.intervals import Floats

DIRECTIONS = 8
"""Sectors, the first about straight ahead."""
MOST_RINGS = 8
FEW_RINGS = 5
"""Whose impulses are all named."""
FEWEST = 3
"""Pushes that a cell needs to be shown."""
COLOURS = "YlOrBr"
"""Darker is more falls, to colour-blind readers and in grey print too."""


def pushes(results: Results, axis: SeverityAxis) -> str:
    """A push plot for each policy; empty without pushes."""
    images = [
        image(push_plot(impulses, fell, policy), f"Falls of {policy} after pushes, by direction and impulse")
        for policy in results.policies
        for impulses, fell in [_pushes(results, axis, policy)]
        if len(fell)
    ]
    lead = note(
        f"Share of the pushes that a fall followed within {FALL_WITHIN:g} s, by the direction in which the robot, seen "
        "from above, was pushed and by the impulse. White: too few pushes."
    )
    return lead + _scale() + grid(images, 4) if images else ""


def _scale() -> str:
    """What the colours mean."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    stops = ", ".join(to_hex(colormaps[COLOURS](share)) for share in np.linspace(0.0, 1.0, 9))
    bar = f'<span class="scale" style="background: linear-gradient(to right, {stops})"></span>'
    return f'<p class="note">0 % {bar} 100 % of the pushes</p>'


def _pushes(results: Results, axis: SeverityAxis, policy: str) -> tuple[Floats, Floats]:
    """Impulses (m, 2) and falls (m,) of the pushes that the robot was upright for."""
    found = [cell.measures for level in axis.levels if (cell := cell_of(results, level.name, policy))]
    impulses = np.concatenate([np.empty((0, 2)), *(each.push_impulse.reshape(-1, 2) for each in found)])
    fell = np.concatenate([np.empty(0), *(each.push_fell.ravel() for each in found)])
    return impulses[np.isfinite(fell)], fell[np.isfinite(fell)]


def push_plot(impulses: Floats, fell: Floats, title: str) -> bytes:
    """Robot seen from above, nose up: pushed towards an angle, (m, 2) N·s forward and left; `fell` (m,) is 1 or 0."""
    from matplotlib import colormaps

    drawn, axes = figure(2.7, 2.7, Margins(0.45, 0.45, 0.5, 0.5), "polar")
    edges, shares = fall_shares(impulses, fell)
    colours = colormaps[COLOURS]
    width = 2.0 * np.pi / DIRECTIONS
    for sector, ring in np.argwhere(np.isfinite(shares)):
        height, shade = edges[ring + 1] - edges[ring], colours(shares[sector, ring])
        axes.bar(sector * width, height, width, edges[ring], color=shade, edgecolor="#ffffff", linewidth=0.6)
    axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
    axes.set_xticks(np.arange(4) * np.pi / 2, ["front", "left", "back", "right"])
    axes.set_yticks([])
    axes.set_ylim(0.0, edges[-1])
    axes.grid(False)
    levels = [amount(level) for level in levels_of(impulses)]
    rings = ", ".join(levels) if len(levels) <= FEW_RINGS else f"{', '.join(levels[:2])} … {levels[-1]}"
    axes.set_xlabel(f"rings: {rings} N·s", fontsize=8)
    axes.set_title(short_name(title))
    return svg(drawn)


def levels_of(impulses: Floats) -> Floats:
    """The impulses that occur, in whole N·s, rising; of many, MOST_RINGS from the least to the largest."""
    levels: Floats = np.unique(np.round(np.hypot(*impulses.T))).astype(np.float64)
    if len(levels) <= MOST_RINGS:
        return levels
    return np.asarray(np.round(np.linspace(levels[0], levels[-1], MOST_RINGS)).astype(np.float64))


def fall_shares(impulses: Floats, fell: Floats) -> tuple[Floats, Floats]:
    """Edges between the rings, and the share of falls in each direction and ring; NaN for too few pushes."""
    levels = levels_of(impulses)
    middles = (levels[1:] + levels[:-1]) / 2.0
    outer = levels[-1] + (levels[-1] - levels[-2] if len(levels) > 1 else levels[-1]) / 2.0
    edges = np.concatenate(([0.0], middles, [outer]))
    ring = np.searchsorted(middles, np.hypot(*impulses.T))
    turn = np.arctan2(impulses[:, 1], impulses[:, 0]) / (2.0 * np.pi)
    cell = (np.round(turn * DIRECTIONS).astype(np.intp) % DIRECTIONS) * len(levels) + ring
    count = np.bincount(cell, minlength=DIRECTIONS * len(levels))
    falls = np.bincount(cell, weights=fell, minlength=DIRECTIONS * len(levels))
    shares = np.where(count >= FEWEST, falls / np.maximum(count, 1), np.nan)
    return edges, shares.reshape(DIRECTIONS, len(levels))
