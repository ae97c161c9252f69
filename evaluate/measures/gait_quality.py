"""How the robot steps and how quietly it carries its trunk: pure functions, upright steps alone, NaN without one."""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools, Floats, Recorded, count, over_steps, quotient, total, upright_rms
from evaluate.measures.footfalls import LONGEST_STRIDE, Footfalls
from quad_env.config import GRAVITY

Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Episodes and their steps."""


def duty_factor(stance: Bools, upright: Bools) -> Floats:
    """Share of the time that each foot stands, (n, 4)."""
    standing = count(stance & over_steps(upright, stance))
    return quotient(standing, count(upright)[:, None])


def foot_clearance(height: Recorded, falls: Footfalls, episodes: int) -> Floats:
    """Peak height above the terrain of each swing, averaged over the swings of all feet, (n,) m."""
    if not len(falls.episode):
        return np.full(episodes, np.nan)
    rows = np.moveaxis(height, 0, -1)
    steps = rows.shape[-1]
    start = (falls.episode * rows.shape[1] + falls.foot) * steps
    # The stretch from a touch-down to the next swing is cut out by taking every other peak.
    cuts = np.stack((start + falls.swing_start, start + falls.touch_down), axis=1).ravel()
    peaks = np.maximum.reduceat(np.ascontiguousarray(rows).ravel(), cuts)[::2].astype(np.float64)
    return _mean_by_episode(peaks, falls.episode, episodes)


def foot_slip(position: Recorded, contact: Bools, upright: Bools, dt: float) -> Floats:
    """Mean horizontal speed of the feet on the ground, (n,) m/s.

    A foot counts between two steps that both find it on the ground. Its centre is followed: a sphere that rolls as the
    leg turns over it adds its rolling.
    """
    held = contact[1:] & contact[:-1] & upright[1:, :, None]
    x, y = (np.diff(position[..., axis].astype(np.float64), axis=0) for axis in (0, 1))
    travel = np.where(held, np.sqrt(x * x + y * y), 0.0)
    return quotient(total(travel).sum(axis=-1), count(held).sum(axis=-1) * dt)


def phase_error(
    falls: Footfalls, diagonals: tuple[tuple[int, int], ...], first: int, episodes: int, steps: int, dt: float
) -> Floats:
    """How far the diagonal pairs are out of step, in cycles, 0 … 0.5, mean over the strides of both pairs, (n,).

    For each stride of the front foot: the time from its first touch-down to the nearest one of the hind foot, over the
    stride's length; 0.5 where the hind foot comes no nearer. Strides count if both swings began at `first` or later.
    `diagonals` are the front and the hind foot of each pair.
    """
    errors, owners = [], []
    late = falls.after(first)
    for front, hind in diagonals:
        episode, step = late.of(front)
        length = np.diff(step)
        stride = (np.diff(episode) == 0) & (length * dt <= LONGEST_STRIDE)
        begin, length, episode = step[:-1][stride], length[stride], episode[:-1][stride]
        errors.append(np.minimum(_nearest(falls.of(hind), (episode, begin), steps) / length, 0.5))
        owners.append(episode)
    return _mean_by_episode(np.concatenate(errors), np.concatenate(owners), episodes)


def needless_steps(falls: Footfalls, still: Bools, upright: Bools, windows: tuple[slice, ...], dt: float) -> Floats:
    """Touch-downs a second of all feet over the windows that `still`, (n, k), picks, (n,) 1/s.

    Windows that were not ended upright do not count; NaN where no window is left.
    """
    found, time = np.zeros(len(still)), np.zeros(len(still))
    for number, window in enumerate(windows):
        counts = still[:, number] & upright[window.stop - 1]
        inside = (falls.touch_down >= window.start) & (falls.touch_down < window.stop)
        found += counts * np.bincount(falls.episode[inside], minlength=len(still))
        time += counts * ((window.stop - window.start) * dt)
    return quotient(found, time)


def turning_rate(rate: Recorded, upright: Bools) -> Floats:
    """Root mean square of one of the trunk's body rates, (n,) rad/s."""
    return upright_rms(rate.astype(np.float64), upright)


def vertical_speed(position: Recorded, upright: Bools, dt: float) -> Floats:
    """Root mean square of the trunk's vertical velocity between steps, (n,) m/s; the first step has none."""
    return upright_rms(np.diff(position[..., 2].astype(np.float64), axis=0) / dt, upright[1:])


def froude_number(distance: Floats, leg_length: float, upright: Bools, dt: float) -> Floats:
    """v² / (g · leg length) of the mean speed `distance` over the upright time, (n,)."""
    speed = quotient(distance, count(upright) * dt)
    return speed * speed / (GRAVITY * leg_length)


def _nearest(falls: Places, wanted: Places, steps: int) -> Floats:
    """Steps from each of the wanted (episode, step) to the nearest of `falls` in its episode; inf without one."""
    apart = 2 * steps  # episodes further apart on the common axis than any two steps within one
    axis = np.concatenate(([-np.inf], falls[0] * apart + falls[1], [np.inf]))
    place = wanted[0] * apart + wanted[1]
    after = np.searchsorted(axis, place)
    nearest = np.minimum(axis[after] - place, place - axis[after - 1])
    return np.where(nearest < steps, nearest, np.inf)


def _mean_by_episode(values: Floats, episode: NDArray[np.intp], episodes: int) -> Floats:
    sums = np.bincount(episode, weights=values, minlength=episodes)
    return quotient(sums, np.bincount(episode, minlength=episodes))
