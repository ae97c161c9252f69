"""How the robot steps; formulas stand in `evaluate.measures.catalogue`.

Upright steps alone, NaN without one.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools, Floats, Recorded, count, quotient, total, upright_mean, upright_share
from evaluate.measures.episodes import Episodes
from evaluate.measures.footfalls import Footfalls, footfalls

LANDING = 0.02
"""s; how long a touch-down lasts, in whole control steps, of which the first is that in which the foot lands."""


def gait(episodes: Episodes, upright: Bools) -> dict[str, Floats]:
    """Every measure of the gait."""
    settling, dt = episodes.settling, episodes.dt
    settled, before, counted = slice(settling, None), slice(settling - 1, None), upright[settling:]
    falls = footfalls(episodes.foot_contact, upright, dt)
    standing = count(falls.stance[settled] & counted[..., None])
    return {
        "duty_factor": quotient(standing, count(counted)[:, None]),
        "step_rate": step_rate(falls, settling, count(counted), dt),
        "flight": upright_share(np.asarray(~falls.stance[settled].any(axis=-1)), counted),
        "trunk_height": upright_mean(episodes.height[settled].astype(np.float64), counted) / episodes.robot.home_height,
        "touchdown_impulse": touchdown_impulse(episodes.foot_impulse, falls, settling, episodes.fall_step, dt)
        / episodes.weight,
        "foot_slip": foot_slip(episodes.foot_position[before], episodes.foot_contact[before], upright[before], dt),
    }


def step_rate(falls: Footfalls, first: int, upright: NDArray[np.int64], dt: float) -> Floats:
    """Touch-downs per foot and second from that step on, of so many upright steps, (n,); 1/s."""
    landed = np.bincount(falls.episode[falls.touch_down >= first], minlength=len(upright))
    return quotient(landed, falls.stance.shape[-1] * dt * upright)


def touchdown_impulse(impulse: Recorded, falls: Footfalls, first: int, end: NDArray[np.int64], dt: float) -> Floats:
    """Impulse of the ground on a foot over LANDING from a touch-down on, mean of those between the steps `first` and
    `end`, (n,), of each episode, (n,) N·s; `impulse`, (steps, n, 4), is that of each control step."""
    length = max(1, round(LANDING / dt))
    whole = (falls.touch_down >= first) & (falls.touch_down + length <= end[falls.episode])
    step, episode, foot = falls.touch_down[whole], falls.episode[whole], falls.foot[whole]
    received = np.asarray(sum(impulse[step + later, episode, foot].astype(np.float64) for later in range(length)))
    sums = np.bincount(episode, weights=received, minlength=len(end))
    return quotient(sums, np.bincount(episode, minlength=len(end)))


def foot_slip(position: Recorded, contact: Bools, upright: Bools, dt: float) -> Floats:
    """Mean horizontal speed of the feet on the ground, (n,) m/s.

    A foot counts between two steps that both find it on the ground. Its centre is followed: a sphere that rolls as the
    leg turns over it adds its rolling.
    """
    held = contact[1:] & contact[:-1] & upright[1:, :, None]
    x, y = (np.diff(position[..., axis].astype(np.float64), axis=0) for axis in (0, 1))
    travel = np.where(held, np.sqrt(x * x + y * y), 0.0)
    return quotient(total(travel).sum(axis=-1), count(held).sum(axis=-1) * dt)
