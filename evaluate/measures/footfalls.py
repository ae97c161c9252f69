"""Footfalls: stance, swing and touch-down of each foot, detected in the recorded contacts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools

Ints = NDArray[np.intp]

MIN_SWING_TIME = 0.04
"""s. A foot that is off the ground for less has not stepped, but bounced."""


@dataclass(frozen=True)
class Footfalls:
    """Contacts of the four feet in n episodes, before the fall."""

    stance: Bools
    """True on the ground, also during bounces, (steps, n, 4)."""
    touch_down: Ints
    """First stance step after each swing that began and ended upright, (swings,)."""
    episode: Ints
    """Index of the episode of each swing, (swings,)."""
    foot: Ints
    """Index of the foot, 0 … 3, (swings,); swings are ordered by episode, then foot, then time."""


def footfalls(contact: Bools, upright: Bools, dt: float) -> Footfalls:
    """Detect the footfalls.

    Args:
        contact: Recorded contacts, (steps, n, 4).
        upright: True for upright steps, which alone count, (steps, n).
        dt: Control step, s.

    Returns:
        Footfalls of all episodes.
    """
    feet = contact.shape[-1]
    stance = debounce(contact & upright[..., None], round(MIN_SWING_TIME / dt))
    row, landing = _landings(np.ascontiguousarray(np.moveaxis(stance, 0, -1)).reshape(-1, len(stance)))
    return Footfalls(stance, landing + 1, row // feet, row % feet)


def _landings(stance: Bools) -> tuple[Ints, Ints]:
    """Return row and last step of each complete swing, for the stance of each foot, (rows, steps)."""
    steps = stance.shape[1]
    change = np.diff(stance.astype(np.int8), axis=1)
    lift_off_row, lift_off = np.nonzero(change == -1)
    landing_row, landing = np.nonzero(change == 1)
    # Lift-offs and landings alternate: the last lift-off before a landing, on the axis of all rows, is of the same
    # foot unless the foot has none.
    latest = np.searchsorted(lift_off_row * steps + lift_off, landing_row * steps + landing) - 1
    owner = np.append(lift_off_row, -1)[latest]  # -1 without a lift-off
    is_swing = owner == landing_row
    return landing_row[is_swing], landing[is_swing]


def debounce(contact: Bools, shortest: int) -> Bools:
    """Fill every gap of fewer than `shortest` steps in the contacts, along the first axis of `contact`."""
    padded = np.concatenate((contact, np.zeros((shortest, *contact.shape[1:]), np.bool_)))
    recent = padded.copy()
    for back in range(1, shortest):
        recent[back:] |= padded[:-back]
    filled = recent.copy()
    for ahead in range(1, shortest):
        filled[:-ahead] &= recent[ahead:]
    return filled[: len(contact)]
