"""Measures of the gait, such as step rate and duty factor (fraction of time in stance).

`evaluate.measures.catalogue` contains their formulas. Only the control steps after the first second and before a fall
enter a measure. The measure is NaN for an episode that has none of these steps.
"""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools, Floats, Recorded, count, quotient, total, upright_mean, upright_share
from evaluate.measures.episodes import Episodes
from evaluate.measures.footfalls import Footfalls, footfalls

TOUCHDOWN_TIME = 0.02
"""Duration of a touch-down, which is the time after the landing of a foot in which its impulse is measured, s.

A touch-down starts with the control step in which the foot lands, and lasts a whole number of control steps.
"""


def gait(episodes: Episodes, upright: Bools) -> dict[str, Floats]:
    """Compute the measures of the gait, such as step rate and duty factor.

    Args:
        episodes: Recorded episodes.
        upright: True for control steps before the robot's fall, (steps, n).

    Returns:
        Name of the measure -> value of each episode, (n,). The duty factor has a value for each foot, (n, 4).
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
    """Return the step rate of each episode: touch-downs of one foot per second, mean of the feet.

    Args:
        falls: Stance and swing phases of the feet in n episodes.
        first: First control step that enters the measure.
        upright: Number of control steps from `first` to the fall or the end of the episode, (n,).
        dt: Duration of a control step, s.

    Returns:
        Step rate, (n,), 1/s.
    """
    landings = np.bincount(falls.episode[falls.touch_down >= first], minlength=len(upright))
    return quotient(landings, falls.stance.shape[-1] * dt * upright)


def touchdown_impulse(impulse: Recorded, falls: Footfalls, first: int, end: NDArray[np.int64], dt: float) -> Floats:
    """Return the mean impulse of the ground on a foot in the first TOUCHDOWN_TIME after landing.

    Args:
        impulse: Impulse of the ground on each foot in each control step, (steps, n, 4), N·s.
        falls: Stance and swing phases of the feet in n episodes.
        first: First control step that enters the measure.
        end: Control step in which each episode ends, (n,).
        dt: Duration of a control step, s.

    Returns:
        Mean over the touch-downs that begin and end between `first` and `end`, (n,), N·s; NaN if an episode has no
        touch-down.
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
    """Return the mean horizontal speed with which feet in contact slip over the ground.

    The movement of a foot between two consecutive control steps enters the mean if the foot is on the ground in both
    steps. The speed is the speed of the foot's centre, so that the rolling of a spherical foot is included.

    Args:
        position: Foot positions, world frame, (steps, n, 4, 3), m.
        contact: True for feet on the ground, (steps, n, 4).
        upright: True for control steps before the robot's fall, (steps, n).
        dt: Duration of a control step, s.

    Returns:
        Speed, (n,), m/s; NaN if no foot is on the ground in two consecutive steps.
    """
    is_held = contact[1:] & contact[:-1] & upright[1:, :, None]
    x = np.diff(position[..., 0].astype(np.float64), axis=0)
    y = np.diff(position[..., 1].astype(np.float64), axis=0)
    travel = np.where(is_held, np.sqrt(x * x + y * y), 0.0)
    return quotient(total(travel).sum(axis=-1), count(is_held).sum(axis=-1) * dt)
