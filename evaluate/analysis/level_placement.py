"""Where the levels of an axis go: one after the other, to where each policy's success and falls cross one half."""

from collections.abc import Sequence

import numpy as np

from evaluate.analysis.breaking_points import OF, failed
from evaluate.rollouts.experiment import Cell
from evaluate.statistics.breaking_point import next_level
from quad_env.scenarios.axes import Axis

NEAREST = 1.05
"""Ratio of two neighbouring severities below which none is put between them."""


def grid(axis: Axis) -> tuple[float, ...]:
    """Every severity that may be run: the levels of the axis, and what halving their gaps over ln(severity) gives."""
    found = [axis.levels[0]]
    for harder in axis.levels[1:]:
        milder = found[-1]
        if milder > 0.0 and harder > 0.0:
            halvings = np.ceil(np.log2(max(abs(np.log(harder / milder)) / np.log(NEAREST), 1.0)))
            between = np.geomspace(milder, harder, 2 ** int(halvings) + 1)[1:-1]
            found += [float(f"{severity:.3g}") for severity in between]
        found.append(harder)
    return tuple(dict.fromkeys(found))


def wanted(cells: Sequence[Cell], severities: Sequence[float], most: int) -> list[float]:
    """Severities, of the grid, that one policy is to run next on an axis; none where nothing is left to be learned.

    Args:
        cells: what it ran on that axis.
        severities: the grid.
        most: levels in all.
    """
    ran = {cell.scenario.severity: cell for cell in cells}
    numbers = [number for number, severity in enumerate(severities) if severity in ran]
    known = [ran[severities[number]] for number in numbers]
    found = [next_level(np.array(severities), numbers, np.array([failed(cell, of) for cell in known])) for of in OF]
    new = dict.fromkeys(severities[number] for number in reversed(found) if number is not None)
    return list(new)[: max(most - len(known), 0)]
