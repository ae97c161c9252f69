"""Footfalls: stance, swing and touch-downs of every foot, found in the recorded contacts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools

Ints = NDArray[np.intp]

SHORTEST_SWING = 0.04
"""s; a foot off the ground for less has not stepped: it rattles."""


@dataclass(frozen=True)
class Footfalls:
    """Contacts of n episodes' four feet, without those from the fall on."""

    stance: Bools
    """On the ground, rattling counted as stance, (steps, n, 4)."""
    touch_down: Ints
    """First step of the stance after each swing, (swings,); of swings begun and ended upright alone."""
    episode: Ints
    """Which episode it belongs to, (swings,)."""
    foot: Ints
    """Which foot, 0 … 3, (swings,); swings are ordered by episode, then foot, then time."""


def footfalls(contact: Bools, upright: Bools, dt: float) -> Footfalls:
    """Footfalls of (steps, n, 4) contacts; `upright`, (steps, n), says which of them count."""
    steps, feet = len(contact), contact.shape[-1]
    stance = debounce(contact & upright[..., None], round(SHORTEST_SWING / dt))
    rows = np.ascontiguousarray(np.moveaxis(stance, 0, -1)).reshape(-1, steps)
    change = np.diff(rows.astype(np.int8), axis=1)
    lifted_row, lifted = np.nonzero(change == -1)
    landed_row, landed = np.nonzero(change == 1)
    # They alternate: the latest lift-off before a landing, on the axis of all rows, is the foot's own if it has one.
    latest = np.searchsorted(lifted_row * steps + lifted, landed_row * steps + landed) - 1
    owner = np.append(lifted_row, -1)[latest]  # -1 without a lift-off
    whole = owner == landed_row
    row = landed_row[whole]
    return Footfalls(stance, landed[whole] + 1, row // feet, row % feet)


def debounce(contact: Bools, shortest: int) -> Bools:
    """The contacts with every gap of fewer than `shortest` steps filled, along the first axis."""
    given = np.concatenate((contact, np.zeros((shortest, *contact.shape[1:]), np.bool_)))
    lately = given.copy()
    for back in range(1, shortest):
        lately[back:] |= given[:-back]
    filled = lately.copy()
    for ahead in range(1, shortest):
        filled[:-ahead] &= lately[ahead:]
    return filled[: len(contact)]
