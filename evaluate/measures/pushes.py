"""What pushes do: when, how hard, from where, and what came of them.

Arrays (n, k): the k pushes of each of n episodes; NaN for a push after the fall.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools, Floats, over_steps, planar, quotient, upright_steps
from evaluate.measures.episodes import Episodes

Ints = NDArray[np.int64]

FALL_WITHIN = 2.0
"""s from a push's onset within which a fall is attributed to it."""
GAIT_CYCLE = 0.4
"""s over which a velocity error is averaged, so that swaying within a stride is none."""
RECOVERED_MARGIN = 0.1
"""m/s above the error of the gait cycle before the push at which the robot has recovered."""
LONGEST_RECOVERY = 2.0
"""s from a push's onset; what takes longer is no recovery."""


def pushes(episodes: Episodes) -> dict[str, Floats]:
    """Every measure of pushes, of all of them, those in the first second too; the impulse is (n, k, 2) N·s.

    A recovery is inf if there is none, or a fall, within LONGEST_RECOVERY; NaN where a new command, the next push or
    the time limit comes too near to say.
    """
    onset = episodes.push_step
    pushed = (onset <= episodes.fall_step[:, None]) & (onset < episodes.steps)
    deadline = np.minimum(onset + round(FALL_WITHIN / episodes.dt), _next(onset, episodes.steps))
    fell = np.where(pushed, episodes.fall_step[:, None] < deadline, np.nan)
    recovery = np.where(pushed & _evaluable(episodes), _recovery(episodes), np.nan)
    return {
        "fall_after_push": _known_mean(fell),
        "not_recovered": not_recovered(recovery),
        "recovery_time": recovery_time(recovery),
        "push_time": np.where(pushed, onset * episodes.dt, np.nan),
        "push_impulse": np.where(pushed[..., None], _in_heading(episodes), np.nan),
        "push_fell": fell,
        "push_recovery": recovery,
    }


def recovery_time(recovery: Floats) -> Floats:
    """Mean time of the recoveries, (n,) s; NaN without one."""
    return _known_mean(np.where(np.isfinite(recovery), recovery, np.nan))


def not_recovered(recovery: Floats) -> Floats:
    """Share of the evaluable pushes after which the robot fell or did not recover, (n,)."""
    return _known_mean(np.where(np.isnan(recovery), np.nan, np.isinf(recovery)))


def _evaluable(episodes: Episodes) -> Bools:
    """Whether command and surroundings stay the same from before a push to the end of the longest recovery, (n, k);
    known before the push, so that no outcome is left out for what it is."""
    onset, dt = episodes.push_step, episodes.dt
    end = onset + round((LONGEST_RECOVERY + GAIT_CYCLE) / dt)
    return np.asarray(episodes.intervals.hold(onset, end) & (end <= _next(onset, episodes.steps)))


def _recovery(episodes: Episodes) -> Floats:
    """Recovery times of evaluable pushes; arbitrary for others."""
    cycle, length = round(GAIT_CYCLE / episodes.dt), episodes.push_steps
    error = cycle_errors(episodes, cycle)
    onset = np.minimum(episodes.push_step, len(error) - 1)
    bound = _at(error, np.maximum(onset - cycle, 0)) + RECOVERED_MARGIN
    recovery = np.full(onset.shape, np.inf)
    for wait in range(round(LONGEST_RECOVERY / episodes.dt), length - 1, -1):  # the earliest is written last
        start = np.minimum(onset + wait, len(error) - 1)
        back = (_at(error, start) <= bound) & (start + cycle <= episodes.fall_step[:, None])
        recovery = np.where(back, wait * episodes.dt, recovery)
    fell = episodes.fall_step[:, None] < episodes.push_step + round(LONGEST_RECOVERY / episodes.dt)
    return np.where(fell, np.inf, recovery)


def cycle_errors(episodes: Episodes, cycle: int) -> Floats:
    """‖mean of command − planar velocity‖ over the gait cycle from each step on, (steps − cycle + 1, n) m/s."""
    error = episodes.command[..., :2].astype(np.float64) - episodes.heading_velocity[..., :2]
    upright = upright_steps(episodes.fall_step, episodes.steps)
    sums = np.cumsum(np.where(over_steps(upright, error), error, 0.0), axis=0)
    sums = np.concatenate((np.zeros((1, *sums.shape[1:])), sums))
    return planar(sums[cycle:] - sums[:-cycle]) / cycle


def _in_heading(episodes: Episodes) -> Floats:
    """The impulses seen along the trunk's nose just before each push, (n, k, 2)."""
    w, x, y, z = np.moveaxis(_at(episodes.quaternion.astype(np.float64), np.maximum(episodes.push_step - 1, 0)), -1, 0)
    nose_x, nose_y = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
    length = np.maximum(np.hypot(nose_x, nose_y), 1e-6)
    cos, sin = nose_x / length, nose_y / length
    east, north = np.moveaxis(episodes.push_impulse, -1, 0)
    return np.stack((cos * east + sin * north, cos * north - sin * east), axis=-1)


def _at(values: Floats, step: Ints) -> Floats:
    """`values`, (steps, n, …), at the steps (n, k) of each episode, (n, k, …)."""
    return values[np.minimum(step, len(values) - 1), np.arange(len(step))[:, None]]


def _next(onset: Ints, steps: int) -> Ints:
    """Step of the push after each, or the time limit, (n, k)."""
    return np.concatenate((onset[:, 1:], np.full((len(onset), 1), steps, onset.dtype)), axis=1)[:, : onset.shape[1]]


def _known_mean(values: Floats) -> Floats:
    known = ~np.isnan(values)
    return quotient(np.where(known, values, 0.0).sum(axis=-1), known.sum(axis=-1))
