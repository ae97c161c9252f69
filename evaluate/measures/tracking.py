"""Measures of command tracking: pure functions of (steps, n, …) arrays in the heading frame.

Every step that is not upright, up to the time limit, counts with the maximum error of the measure, so that a fall never
makes an error smaller.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.measures.averages import Bools, Floats, over_steps, planar, quotient, total, upright_mean

SETTLING_TIME = 1.0
"""s. Time at the start of an episode, and of each command interval, that does not count."""
VELOCITY_CAP = 2.0
"""m/s. Maximum planar velocity error of a step, and the error of every step after a fall."""
YAW_RATE_CAP = 3.0
"""rad/s. Maximum yaw-rate error of a step, and the error of every step after a fall."""


@dataclass(frozen=True)
class CommandIntervals:
    """Command intervals of an episode, as slices of its control steps."""

    settled: tuple[slice, ...]
    """Steps after the first second of each interval; an interval without any is left out."""
    travelled: tuple[slice, ...]
    """Steps after the first second of the episode."""


def command_intervals(steps: int, command_steps: int, settling: int) -> CommandIntervals:
    """Return the command intervals of an episode.

    Args:
        steps: Control steps of the episode.
        command_steps: Control steps of a command.
        settling: Control steps of SETTLING_TIME.

    Returns:
        The intervals.
    """
    intervals = [slice(start, min(start + command_steps, steps)) for start in range(0, steps, command_steps)]
    return CommandIntervals(
        settled=tuple(
            slice(each.start + settling, each.stop) for each in intervals if each.stop - each.start > settling
        ),
        travelled=tuple(slice(max(each.start, settling), each.stop) for each in intervals if each.stop > settling),
    )


def velocity_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Return the mean planar velocity error of all steps, VELOCITY_CAP after a fall.

    Args:
        command: (steps, n, 3), m/s, m/s, rad/s.
        velocity: Heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).

    Returns:
        Error, (n,), m/s.
    """
    return total(_capped(planar(command - velocity), upright, VELOCITY_CAP)) / len(upright)


def yaw_rate_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Return the mean yaw-rate error of all steps, YAW_RATE_CAP after a fall.

    Args:
        command: (steps, n, 3), m/s, m/s, rad/s.
        velocity: Heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).

    Returns:
        Error, (n,), rad/s.
    """
    return total(_capped(np.abs(command[..., 2] - velocity[..., 2]), upright, YAW_RATE_CAP)) / len(upright)


def velocity_error_upright(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Return the mean planar velocity error of the upright steps, at most VELOCITY_CAP each.

    Args:
        command: (steps, n, 3), m/s, m/s, rad/s.
        velocity: Heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).

    Returns:
        Error, (n,), m/s; NaN without an upright step.
    """
    return upright_mean(np.minimum(planar(command - velocity), VELOCITY_CAP), upright)


def mean_velocity_error(command: Floats, velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """Return ‖command - mean velocity‖ of each window, averaged over the steps of the windows.

    The mean velocity is over a window's upright steps, and its error counts for each of them; the error of the other
    steps is VELOCITY_CAP.

    Args:
        command: (steps, n, 3), m/s, m/s, rad/s.
        velocity: Heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        windows: Slices of the steps, with one command each.

    Returns:
        Error, (n,), m/s.
    """
    errors = np.zeros(upright.shape[1])
    steps = 0
    for window in windows:
        error = planar(command[window.start] - window_mean(velocity, upright, window))
        upright_count = upright[window].sum(axis=0)
        length = window.stop - window.start
        errors += np.where(upright_count > 0, np.minimum(error, VELOCITY_CAP) * upright_count, 0.0)
        errors += VELOCITY_CAP * (length - upright_count)
        steps += length
    return errors / steps


def commands_given(command: Floats, upright: Bools, starts: tuple[int, ...]) -> Floats:
    """Return the commands at the starts of the intervals.

    Args:
        command: (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        starts: First steps of the k intervals.

    Returns:
        Commands, (n, k, 3); NaN if the robot was not upright.
    """
    return np.stack([np.where(upright[start, :, None], command[start], np.nan) for start in starts], axis=1)


def mean_velocities(velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """Return the mean velocity over each window.

    Args:
        velocity: Heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        windows: Slices of the steps, k.

    Returns:
        Mean velocities, (n, k, 3); NaN if the robot was not upright at the end of the window.
    """
    means = [
        np.where(upright[window.stop - 1, :, None], window_mean(velocity, upright, window), np.nan)
        for window in windows
    ]
    return np.stack(means, axis=1)


def distance_covered(velocity: Floats, upright: Bools, stretches: tuple[slice, ...], dt: float) -> Floats:
    """Return the distance along the mean velocity of each stretch, over the upright steps.

    Args:
        velocity: Heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        stretches: Slices of the steps.
        dt: Control step, s.

    Returns:
        Distance, (n,), m.
    """
    covered = [planar(total(np.where(upright[stretch, :, None], velocity[stretch], 0.0))) * dt for stretch in stretches]
    return np.asarray(np.add.reduce(covered))


def window_mean(velocity: Floats, upright: Bools, window: slice) -> Floats:
    """Return the mean velocity over a window's upright steps.

    Args:
        velocity: Heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        window: Slice of the steps.

    Returns:
        Mean, (n, 3); NaN without an upright step.
    """
    mask = upright[window]
    return quotient(total(np.where(over_steps(mask, velocity), velocity[window], 0.0)), mask.sum(0)[:, None])


def _capped(error: Floats, upright: Bools, cap: float) -> Floats:
    """Return the error of each step, at most `cap`, and `cap` in steps that are not upright."""
    return np.where(upright, np.minimum(error, cap), cap)
