"""Footfalls: stance phases, swing phases and touch-downs of each foot, from the recorded contacts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools

Ints = NDArray[np.intp]

MIN_SWING_TIME = 0.04
"""Minimum duration of a swing phase, s; a shorter loss of contact counts as a bounce during stance."""


@dataclass(frozen=True)
class Footfalls:
    """Stance and swing phases of the four feet in n episodes, before a fall."""

    stance: Bools
    """True while a foot is in stance, (steps, n, 4); a loss of contact shorter than MIN_SWING_TIME is included."""
    touch_down: Ints
    """Touch-down of each swing phase: the first control step of the stance that follows, (swings,).

    Only swing phases that began and ended before a fall are included.
    """
    episode: Ints
    """Index of the episode of each swing phase, (swings,)."""
    foot: Ints
    """Index of the foot of each swing phase, 0 … 3 in the order FL, FR, RL, RR, (swings,).

    The swing phases are sorted by episode, then by foot, then by time.
    """


def footfalls(contact: Bools, upright: Bools, dt: float) -> Footfalls:
    """Detect stance phases, swing phases and touch-downs in the recorded contacts.

    Args:
        contact: True if a foot touches the ground, (steps, n, 4).
        upright: True for control steps before a fall, (steps, n); other steps are ignored.
        dt: Duration of a control step, s.

    Returns:
        Footfalls of all episodes.
    """
    feet = contact.shape[-1]
    stance = debounce(contact & upright[..., None], round(MIN_SWING_TIME / dt))
    row, landing = _landings(np.ascontiguousarray(np.moveaxis(stance, 0, -1)).reshape(-1, len(stance)))
    return Footfalls(stance, landing + 1, row // feet, row % feet)


def _landings(stance: Bools) -> tuple[Ints, Ints]:
    """Find the swing phases that have both a lift-off and a landing.

    Args:
        stance: True while a foot is in stance, (rows, steps), with a row for each foot of each episode.

    Returns:
        Row index of each swing phase, (swings,), and the last control step of each swing phase, (swings,).
    """
    steps = stance.shape[1]
    change = np.diff(stance.astype(np.int8), axis=1)
    lift_off_row, lift_off = np.nonzero(change == -1)
    landing_row, landing = np.nonzero(change == 1)
    # All rows (feet) are searched as one sequence of steps. Because lift-offs and landings of a foot alternate, the
    # last lift-off before a landing is in the same row, unless the foot has not lifted off before.
    latest = np.searchsorted(lift_off_row * steps + lift_off, landing_row * steps + landing) - 1
    # Row of the last lift-off before each landing; it is -1 if there is no earlier lift-off.
    owner = np.append(lift_off_row, -1)[latest]
    is_swing = owner == landing_row
    return landing_row[is_swing], landing[is_swing]


def debounce(contact: Bools, shortest: int) -> Bools:
    """Remove short interruptions of the contact of each foot with the ground (debouncing).

    Args:
        contact: True if a foot touches the ground, (steps, …).
        shortest: Number of control steps; every shorter interruption between two contacts becomes contact.

    Returns:
        True if a foot touches the ground or its contact is interrupted only shortly, (steps, …).
    """
    padded = np.concatenate((contact, np.zeros((shortest, *contact.shape[1:]), np.bool_)))
    recent = padded.copy()
    for back in range(1, shortest):
        recent[back:] |= padded[:-back]
    filled = recent.copy()
    for ahead in range(1, shortest):
        filled[:-ahead] &= recent[ahead:]
    return filled[: len(contact)]
