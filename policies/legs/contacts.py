"""Contacts of the feet over time, commanded and measured, and what they say of the gait."""

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import TURN, Floats

Contacts = NDArray[np.bool_]


def duty_factors(contacts: Contacts) -> Floats:
    """Share of the time that each foot is on the ground, (..., 4), for contacts (steps, ..., 4)."""
    shares: Floats = contacts.mean(axis=0)
    return shares


def landings(contacts: Contacts, cycles: Floats, duty: Floats) -> Contacts:
    """Control steps at which feet land, (steps, ..., 4), of contacts of that shape.

    A landing is the first contact after a foot was in the air in the second half of its swing, so that a bounce within
    the stance is none. `cycles` is each leg's place in its cycle, from 0 at the start of its swing up to 1,
    (steps, ..., 4); `duty` the duty factor, (steps, ...).
    """
    swing_share = 1.0 - duty[..., None]
    late = (cycles >= 0.5 * swing_share) & (cycles < swing_share)
    flying = np.zeros(contacts.shape[1:], np.bool_)
    landed = np.zeros_like(contacts)
    for step, contact in enumerate(contacts):
        landed[step] = flying & contact
        flying = (flying | late[step]) & ~contact
    return landed


def landing_offsets(landed: Contacts, phase: Floats) -> Floats:
    """Phase of each leg ahead of the first one's by its mean landing, cycles from -1/2 to 1/2, (..., 4).

    From landings (steps, ..., 4) and the clock (steps, ...), rad; nan for a foot that never landed.
    """
    mean = (landed * np.exp(1j * phase)[..., None]).sum(axis=0)
    angle = np.where(mean == 0.0, np.nan, np.angle(mean))
    return wrapped((angle[..., :1] - angle) / TURN)


def wrapped(cycles: Floats) -> Floats:
    """The same share of a cycle, from -1/2 up to 1/2."""
    return (cycles + 0.5) % 1.0 - 0.5
