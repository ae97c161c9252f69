"""How well commands are followed: pure functions over (steps, n, …) arrays in the heading frame.

Every step that is not upright, up to the time limit, is assigned the maximum error of the measure, so that a fall never
makes an error smaller.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.measures.averages import Bools, Floats, over_steps, planar, quotient, total, upright_mean

SETTLING_TIME = 1.0
"""Start of an episode, and of each command interval, that is not evaluated, s."""
VELOCITY_CAP = 2.0
"""Maximum planar velocity error of a step, m/s, and the error of every step after a fall."""
YAW_RATE_CAP = 3.0
"""Maximum yaw-rate error of a step, rad/s, and the error of every step after a fall."""


@dataclass(frozen=True)
class CommandIntervals:
    """Command intervals of an episode, as slices of its control steps."""

    settled: tuple[slice, ...]
    """After the first second of each; an interval that is not longer is left out."""
    travelled: tuple[slice, ...]
    """After the first second of the episode."""


def command_intervals(steps: int, command_steps: int, settling: int) -> CommandIntervals:
    """Intervals of an episode of so many control steps; a command lasts `command_steps`, settling takes `settling`."""
    whole = [slice(start, min(start + command_steps, steps)) for start in range(0, steps, command_steps)]
    return CommandIntervals(
        settled=tuple(slice(i.start + settling, i.stop) for i in whole if i.stop - i.start > settling),
        travelled=tuple(slice(max(i.start, settling), i.stop) for i in whole if i.stop > settling),
    )


def velocity_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Mean planar velocity error of all given steps, the maximum after a fall, (n,) m/s."""
    return total(_capped(planar(command - velocity), upright, VELOCITY_CAP)) / len(upright)


def yaw_rate_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Mean yaw-rate error of all given steps, the maximum after a fall, (n,) rad/s."""
    return total(_capped(np.abs(command[..., 2] - velocity[..., 2]), upright, YAW_RATE_CAP)) / len(upright)


def velocity_error_upright(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Mean capped planar velocity error of the upright steps alone, (n,) m/s; NaN where there is none."""
    return upright_mean(np.minimum(planar(command - velocity), VELOCITY_CAP), upright)


def mean_velocity_error(command: Floats, velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """‖command − mean velocity‖ of each window, averaged over the windows' steps, (n,) m/s.

    The mean is taken over a window's upright steps and its error counts for each of them; others have the maximum.
    """
    errors, steps = np.zeros(upright.shape[1]), 0
    for window in windows:
        error = planar(command[window.start] - window_mean(velocity, upright, window))
        standing = upright[window].sum(axis=0)
        length = window.stop - window.start
        errors += np.where(standing > 0, np.minimum(error, VELOCITY_CAP) * standing, 0.0)
        errors += VELOCITY_CAP * (length - standing)
        steps += length
    return errors / steps


def commands_given(command: Floats, upright: Bools, starts: tuple[int, ...]) -> Floats:
    """Commands at the starts of the intervals, (n, k, 3); NaN where the robot was not upright any more."""
    return np.stack([np.where(upright[start, :, None], command[start], np.nan) for start in starts], axis=1)


def mean_velocities(velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """Mean heading velocity over each window, (n, k, 3); NaN where the robot was not upright to the window's end."""
    means = [
        np.where(upright[window.stop - 1, :, None], window_mean(velocity, upright, window), np.nan)
        for window in windows
    ]
    return np.stack(means, axis=1)


def distance_covered(velocity: Floats, upright: Bools, stretches: tuple[slice, ...], dt: float) -> Floats:
    """Distance along the mean heading velocity of each stretch, upright steps, (n,) m."""
    covered = [planar(total(np.where(upright[stretch, :, None], velocity[stretch], 0.0))) * dt for stretch in stretches]
    return np.asarray(np.add.reduce(covered))


def window_mean(velocity: Floats, upright: Bools, window: slice) -> Floats:
    """Mean over a window's upright steps, (n, 3); NaN where there is none."""
    standing = upright[window]
    return quotient(total(np.where(over_steps(standing, velocity), velocity[window], 0.0)), standing.sum(0)[:, None])


def _capped(error: Floats, upright: Bools, cap: float) -> Floats:
    return np.where(upright, np.minimum(error, cap), cap)
