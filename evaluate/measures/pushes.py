"""What pushes do: when, how hard, from where, and what came of them.

Arrays (n, k): the k pushes of each of n episodes; NaN for a push after the fall.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Floats, quotient
from evaluate.measures.episodes import Episodes

Ints = NDArray[np.int64]

FALL_WITHIN = 2.0
"""s from a push's onset within which a fall is attributed to it."""


def pushes(episodes: Episodes) -> dict[str, Floats]:
    """Every measure of pushes, of all of them, those in the first second too; the impulse is (n, k, 2) N·s."""
    onset = episodes.push_step
    pushed = (onset <= episodes.fall_step[:, None]) & (onset < episodes.steps)
    deadline = np.minimum(onset + round(FALL_WITHIN / episodes.dt), _next(onset, episodes.steps))
    fell = pushed & (episodes.fall_step[:, None] < deadline)
    return {
        "fall_after_push": quotient(fell.sum(axis=-1), pushed.sum(axis=-1)),
        "push_time": np.where(pushed, onset * episodes.dt, np.nan),
        "push_impulse": np.where(pushed[..., None], _in_heading(episodes), np.nan),
        "push_fell": np.where(pushed, fell, np.nan),
    }


def _in_heading(episodes: Episodes) -> Floats:
    """The impulses seen along the trunk's nose just before each push, (n, k, 2)."""
    before = np.clip(episodes.push_step - 1, 0, episodes.steps - 1), np.arange(episodes.count)[:, None]
    w, x, y, z = np.moveaxis(episodes.quaternion[before].astype(np.float64), -1, 0)
    nose_x, nose_y = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
    length = np.maximum(np.hypot(nose_x, nose_y), 1e-6)
    cos, sin = nose_x / length, nose_y / length
    east, north = np.moveaxis(episodes.push_impulse, -1, 0)
    return np.stack((cos * east + sin * north, cos * north - sin * east), axis=-1)


def _next(onset: Ints, steps: int) -> Ints:
    """Step of the push after each, or the time limit, (n, k)."""
    return np.concatenate((onset[:, 1:], np.full((len(onset), 1), steps, onset.dtype)), axis=1)[:, : onset.shape[1]]
