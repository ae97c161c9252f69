"""Measures of pushes on the trunk: time and impulse of each push, and the falls that follow.

Arrays have the shape (n, k, …) for k pushes in each of n episodes. Their values are NaN for pushes after a fall.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Floats, quotient
from evaluate.measures.episodes import Episodes

Ints = NDArray[np.int64]

MAX_TIME_TO_FALL = 2.0
"""Maximum time between the start of a push and a fall that is attributed to the push, s."""


def pushes(episodes: Episodes) -> dict[str, Floats]:
    """Compute the measures of the k pushes in each of n recorded `episodes`: name of the measure -> array.

    `push_time`, (n, k), is the start of each push, s. `push_impulse`, (n, k, 2), is its impulse in the heading frame,
    N·s. `push_fell`, (n, k), is 1 if a fall follows the push, else 0. `fall_after_push`, (n,), is the fraction of
    pushes that a fall follows.
    """
    onset = episodes.push_step
    fall = episodes.fall_step[:, None]
    is_pushed = (onset <= fall) & (onset < episodes.steps)
    deadline = np.minimum(onset + round(MAX_TIME_TO_FALL / episodes.dt), _next_onset(onset, episodes.steps))
    fell = is_pushed & (fall < deadline)
    return {
        "fall_after_push": quotient(fell.sum(axis=-1), is_pushed.sum(axis=-1)),
        "push_time": np.where(is_pushed, onset * episodes.dt, np.nan),
        "push_impulse": np.where(is_pushed[..., None], _heading_impulse(episodes), np.nan),
        "push_fell": np.where(is_pushed, fell, np.nan),
    }


def _heading_impulse(episodes: Episodes) -> Floats:
    """Return the impulse of each of k pushes, heading frame before the push, x and y, (n, k, 2), N·s."""
    step_before = np.clip(episodes.push_step - 1, 0, episodes.steps - 1)
    quaternion = episodes.quaternion[step_before, np.arange(episodes.count)[:, None]].astype(np.float64)
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    forward = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z)])
    cos, sin = forward / np.maximum(np.hypot(*forward), 1e-6)
    impulse_x, impulse_y = np.moveaxis(episodes.push_impulse, -1, 0)
    return np.stack((cos * impulse_x + sin * impulse_y, cos * impulse_y - sin * impulse_x), axis=-1)


def _next_onset(onset: Ints, steps: int) -> Ints:
    """Return, for each of k pushes, the control step in which the next push begins, (n, k).

    Args:
        onset: Control step in which each push begins, (n, k).
        steps: Number of control steps of an episode, which is returned for the last push.

    Returns:
        Control steps, (n, k).
    """
    return np.concatenate((onset[:, 1:], np.full((len(onset), 1), steps, onset.dtype)), axis=1)[:, : onset.shape[1]]
