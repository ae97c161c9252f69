"""Footfalls: stance, swing and touch-down of each foot, detected in the recorded contacts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools

Ints = NDArray[np.intp]

MIN_SWING_TIME = 0.04
"""Minimum duration of a swing, s; a shorter loss of contact is a bounce."""


@dataclass(frozen=True)
class Footfalls:
    """Contacts of the four feet in n episodes, before the fall."""

    stance: Bools
    """True while a foot is on the ground or bounces, (steps, n, 4)."""
    touch_down: Ints
    """First stance step after each swing that began and ended while the robot was upright, (swings,)."""
    episode: Ints
    """Index of the episode of each swing, (swings,)."""
    foot: Ints
    """Index of the foot of each swing, 0 … 3, (swings,).

    Swings are sorted by episode, then by foot, then by time.
    """


def footfalls(contact: Bools, upright: Bools, dt: float) -> Footfalls:
    """Detect the footfalls.

    Args:
        contact: Recorded contacts, (steps, n, 4).
        upright: True for upright steps, (steps, n); other steps do not count.
        dt: Duration of a control step, s.

    Returns:
        Footfalls of all episodes.
    """
    feet = contact.shape[-1]
    stance = debounce(contact & upright[..., None], round(MIN_SWING_TIME / dt))
    row, landing = _landings(np.ascontiguousarray(np.moveaxis(stance, 0, -1)).reshape(-1, len(stance)))
    return Footfalls(stance, landing + 1, row // feet, row % feet)


def _landings(stance: Bools) -> tuple[Ints, Ints]:
    """Return the row and the last step of each complete swing, (swings,) each.

    `stance`, (rows, steps), has a row for each foot of each episode.
    """
    steps = stance.shape[1]
    change = np.diff(stance.astype(np.int8), axis=1)
    lift_off_row, lift_off = np.nonzero(change == -1)
    landing_row, landing = np.nonzero(change == 1)
    # All rows are searched as one sequence of steps. Lift-offs and landings of a foot alternate, so the last lift-off
    # before a landing is in the same row, unless the foot has not lifted off before.
    latest = np.searchsorted(lift_off_row * steps + lift_off, landing_row * steps + landing) - 1
    owner = np.append(lift_off_row, -1)[latest]  # -1 if no row has lifted off before
    is_swing = owner == landing_row
    return landing_row[is_swing], landing[is_swing]


def debounce(contact: Bools, shortest: int) -> Bools:
    """Set `contact`, (steps, …), to True in every gap of fewer than `shortest` steps between contacts."""
    padded = np.concatenate((contact, np.zeros((shortest, *contact.shape[1:]), np.bool_)))
    recent = padded.copy()
    for back in range(1, shortest):
        recent[back:] |= padded[:-back]
    filled = recent.copy()
    for ahead in range(1, shortest):
        filled[:-ahead] &= recent[ahead:]
    return filled[: len(contact)]
