"""Falls after pushes, by direction and impulse, of all the scenarios of an axis together."""

import numpy as np

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis
from evaluate.measures.pushes import FALL_WITHIN
from evaluate.report.html import grid, image, note
from evaluate.report.plots.drawing import cell_of
from evaluate.report.plots.push_plot import COLOURS, push_plot
from evaluate.statistics.intervals import Floats


def pushes(results: Results, axis: SeverityAxis) -> str:
    """A push plot for each policy; empty where nobody was pushed."""
    images = [
        image(push_plot(impulses, fell, policy), f"Falls of {policy} after pushes, by direction and impulse")
        for policy in results.policies
        for impulses, fell in [_pushes(results, axis, policy)]
        if len(fell)
    ]
    lead = note(
        f"Share of the pushes that a fall followed within {FALL_WITHIN:g} s, by the direction in which the robot, seen "
        "from above, was pushed and by the impulse. White: too few pushes to tell."
    )
    return lead + scale() + grid(images, 4) if images else ""


def scale() -> str:
    """What the colours mean."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    stops = ", ".join(to_hex(colormaps[COLOURS](share)) for share in np.linspace(0.0, 1.0, 9))
    bar = f'<span class="scale" style="background: linear-gradient(to right, {stops})"></span>'
    return f'<p class="note">0 % {bar} 100 % of the pushes</p>'


def _pushes(results: Results, axis: SeverityAxis, policy: str) -> tuple[Floats, Floats]:
    """Impulses (m, 2) and falls (m,) of the pushes that the robot was upright for."""
    cells = [cell for level in axis.levels if (cell := cell_of(results, level.name, policy))]
    impulses = [cell.measures.push_impulse.reshape(-1, 2) for cell in cells]
    fell = [cell.measures.push_fell.ravel() for cell in cells]
    if not cells:
        return np.empty((0, 2)), np.empty(0)
    happened = np.isfinite(np.concatenate(fell))
    return np.concatenate(impulses)[happened], np.concatenate(fell)[happened]
