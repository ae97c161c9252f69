"""Measures of command tracking: pure functions of (steps, n, …) arrays in the heading frame.

Every step from a fall to the time limit counts with the maximum error of the measure, because a fall must not reduce
an error. Only `velocity_error_upright`, `mean_velocities` and `distance_covered` ignore these steps.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.measures.averages import Bools, Floats, over_steps, planar, quotient, total, upright_mean

SETTLING_TIME = 1.0
"""Time that does not count at the start of an episode and of each command interval, s."""
VELOCITY_CAP = 2.0
"""Maximum planar velocity error of a step, and the error of every step after a fall, m/s."""
YAW_RATE_CAP = 3.0
"""Maximum yaw-rate error of a step, and the error of every step after a fall, rad/s."""


@dataclass(frozen=True)
class CommandIntervals:
    """Periods of constant command in an episode, as slices of the control steps."""

    settled: tuple[slice, ...]
    """Steps of each interval after the interval's first second; intervals of at most 1 s are left out."""
    travelled: tuple[slice, ...]
    """Steps of each interval after the episode's first second."""


def command_intervals(steps: int, command_steps: int, settling: int) -> CommandIntervals:
    """Return the command intervals of an episode.

    Args:
        steps: Number of control steps of the episode.
        command_steps: Duration of a command interval in control steps.
        settling: SETTLING_TIME in control steps.

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
    """Return the mean planar velocity error of all steps; the error after a fall is VELOCITY_CAP.

    Args:
        command: Commanded velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        velocity: Trunk velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).

    Returns:
        Error, (n,), m/s.
    """
    return total(_capped(planar(command - velocity), upright, VELOCITY_CAP)) / len(upright)


def yaw_rate_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Return the mean yaw-rate error of all steps; the error after a fall is YAW_RATE_CAP.

    Args:
        command: Commanded velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        velocity: Trunk velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).

    Returns:
        Error, (n,), rad/s.
    """
    return total(_capped(np.abs(command[..., 2] - velocity[..., 2]), upright, YAW_RATE_CAP)) / len(upright)


def velocity_error_upright(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Return the mean planar velocity error of the upright steps, at most VELOCITY_CAP each.

    Args:
        command: Commanded velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        velocity: Trunk velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).

    Returns:
        Error, (n,), m/s; NaN if an episode has no upright step.
    """
    return upright_mean(np.minimum(planar(command - velocity), VELOCITY_CAP), upright)


def mean_velocity_error(command: Floats, velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """Return the mean over all windows of the planar error ‖command - mean velocity‖.

    The mean velocity of a window is computed over its upright steps. A window's error counts once for each upright
    step; each other step counts with the error VELOCITY_CAP.

    Args:
        command: Commanded velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        velocity: Trunk velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
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
        command: Commanded velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        starts: First steps of the k intervals.

    Returns:
        Commands, (n, k, 3), m/s, m/s, rad/s; NaN if the robot was not upright at the interval's start.
    """
    return np.stack([np.where(upright[start, :, None], command[start], np.nan) for start in starts], axis=1)


def mean_velocities(velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """Return the mean velocity over each window.

    Args:
        velocity: Trunk velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        windows: k slices of the steps.

    Returns:
        Mean velocities, (n, k, 3); NaN if the robot was not upright at the end of the window.
    """
    means = [
        np.where(upright[window.stop - 1, :, None], window_mean(velocity, upright, window), np.nan)
        for window in windows
    ]
    return np.stack(means, axis=1)


def distance_covered(velocity: Floats, upright: Bools, stretches: tuple[slice, ...], dt: float) -> Floats:
    """Return the covered distance: ‖mean velocity‖ × upright time, summed over stretches of steps.

    Args:
        velocity: Trunk velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        stretches: Slices of the steps, one for each command interval.
        dt: Duration of a control step, s.

    Returns:
        Distance, (n,), m.
    """
    covered = [planar(total(np.where(upright[stretch, :, None], velocity[stretch], 0.0))) * dt for stretch in stretches]
    return np.asarray(np.add.reduce(covered))


def window_mean(velocity: Floats, upright: Bools, window: slice) -> Floats:
    """Return the mean velocity over a window's upright steps.

    Args:
        velocity: Trunk velocity, heading frame, (steps, n, 3), m/s, m/s, rad/s.
        upright: True for upright steps, (steps, n).
        window: Slice of the steps.

    Returns:
        Mean, (n, 3), m/s, m/s, rad/s; NaN if the window has no upright step.
    """
    mask = upright[window]
    return quotient(total(np.where(over_steps(mask, velocity), velocity[window], 0.0)), mask.sum(0)[:, None])


def _capped(error: Floats, upright: Bools, cap: float) -> Floats:
    """Limit the error of each step to `cap`, and set the error to `cap` in steps that are not upright."""
    return np.where(upright, np.minimum(error, cap), cap)
