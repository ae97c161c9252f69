"""Measures of the gait; formulas are in `evaluate.measures.catalogue`.

Only upright steps count; NaN without one.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools, Floats, Recorded, count, quotient, total, upright_mean, upright_share
from evaluate.measures.episodes import Episodes
from evaluate.measures.footfalls import Footfalls, footfalls

TOUCHDOWN_TIME = 0.02
"""s. Duration of a touch-down in whole control steps; the first is the step in which the foot lands."""


def gait(episodes: Episodes, upright: Bools) -> dict[str, Floats]:
    """Compute the measures of the gait.

    Args:
        episodes: Recorded episodes.
        upright: True for upright steps, (steps, n).

    Returns:
        Name -> measure of each episode, (n,); the duty factor of each foot, (n, 4).
    """
    settling = episodes.settling
    dt = episodes.dt
    settled = slice(settling, None)
    one_before = slice(settling - 1, None)
    counted = upright[settled]
    upright_count = count(counted)
    falls = footfalls(episodes.foot_contact, upright, dt)
    stance_count = count(falls.stance[settled] & counted[..., None])
    impulse = touchdown_impulse(episodes.foot_impulse, falls, settling, episodes.fall_step, dt)
    height = upright_mean(episodes.height[settled].astype(np.float64), counted)
    return {
        "duty_factor": quotient(stance_count, upright_count[:, None]),
        "step_rate": step_rate(falls, settling, upright_count, dt),
        "flight": upright_share(np.asarray(~falls.stance[settled].any(axis=-1)), counted),
        "trunk_height": height / episodes.robot.home_height,
        "touchdown_impulse": impulse / episodes.weight,
        "foot_slip": foot_slip(
            episodes.foot_position[one_before], episodes.foot_contact[one_before], upright[one_before], dt
        ),
    }


def step_rate(falls: Footfalls, first: int, upright: NDArray[np.int64], dt: float) -> Floats:
    """Return the touch-downs per foot and second.

    Args:
        falls: Footfalls of n episodes.
        first: First step that counts.
        upright: Number of upright steps from `first` on, (n,).
        dt: Control step, s.

    Returns:
        Step rate, (n,), 1/s.
    """
    landings = np.bincount(falls.episode[falls.touch_down >= first], minlength=len(upright))
    return quotient(landings, falls.stance.shape[-1] * dt * upright)


def touchdown_impulse(impulse: Recorded, falls: Footfalls, first: int, end: NDArray[np.int64], dt: float) -> Floats:
    """Return the mean impulse of the ground on a foot during TOUCHDOWN_TIME from a touch-down on.

    Args:
        impulse: Impulse on each foot in each control step, (steps, n, 4), N·s.
        falls: Footfalls of n episodes.
        first: First step that counts.
        end: End of each episode, (n,).
        dt: Control step, s.

    Returns:
        Mean of the touch-downs that are complete between `first` and `end`, (n,), N·s; NaN without one.
    """
    length = max(1, round(TOUCHDOWN_TIME / dt))
    is_complete = (falls.touch_down >= first) & (falls.touch_down + length <= end[falls.episode])
    step = falls.touch_down[is_complete]
    episode = falls.episode[is_complete]
    foot = falls.foot[is_complete]
    received = np.asarray(sum(impulse[step + later, episode, foot].astype(np.float64) for later in range(length)))
    sums = np.bincount(episode, weights=received, minlength=len(end))
    return quotient(sums, np.bincount(episode, minlength=len(end)))


def foot_slip(position: Recorded, contact: Bools, upright: Bools, dt: float) -> Floats:
    """Return the mean horizontal speed of the feet on the ground.

    A foot counts between two steps that both find it on the ground. The speed is of its centre, so a spherical foot
    adds its rolling as the leg turns over it.

    Args:
        position: World frame, (steps, n, 4, 3), m.
        contact: (steps, n, 4).
        upright: True for upright steps, (steps, n).
        dt: Control step, s.

    Returns:
        Speed, (n,), m/s; NaN without contact.
    """
    is_held = contact[1:] & contact[:-1] & upright[1:, :, None]
    x = np.diff(position[..., 0].astype(np.float64), axis=0)
    y = np.diff(position[..., 1].astype(np.float64), axis=0)
    travel = np.where(is_held, np.sqrt(x * x + y * y), 0.0)
    return quotient(total(travel).sum(axis=-1), count(is_held).sum(axis=-1) * dt)
