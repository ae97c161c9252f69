"""Measures of command tracking: pure functions of arrays, (steps, n, …), in the heading frame.

In the measures of the error, every control step after a fall has the largest possible error, because a fall must not
reduce an error. `velocity_error_upright`, `mean_velocities` and `distance_covered` exclude these steps.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.measures.averages import Bools, Floats, over_steps, planar, quotient, total, upright_mean

SETTLING_TIME = 1.0
"""Time at the start of an episode, and of each interval of constant command, that measures of tracking exclude, s."""
VELOCITY_CAP = 2.0
"""Upper limit of the planar velocity error of a control step, m/s; every control step after a fall has this error."""
YAW_RATE_CAP = 3.0
"""Upper limit of the yaw-rate error of a control step, rad/s; every control step after a fall has this error."""


@dataclass(frozen=True)
class CommandIntervals:
    """Intervals of an episode in which the velocity command is constant, as slices of its control steps."""

    settled: tuple[slice, ...]
    """Control steps of each command interval after its first second; intervals of at most 1 s are left out."""
    travelled: tuple[slice, ...]
    """Control steps of each command interval, except for the first second of the episode."""


def command_intervals(steps: int, command_steps: int, settling: int) -> CommandIntervals:
    """Return the intervals of an episode in which the velocity command is constant.

    Args:
        steps: Number of control steps of the episode.
        command_steps: Duration of a command interval, in control steps.
        settling: Number of control steps in the first second (SETTLING_TIME), which is excluded.

    Returns:
        Slices of the control steps of all command intervals.
    """
    intervals = [slice(start, min(start + command_steps, steps)) for start in range(0, steps, command_steps)]
    return CommandIntervals(
        settled=tuple(
            slice(each.start + settling, each.stop) for each in intervals if each.stop - each.start > settling
        ),
        travelled=tuple(slice(max(each.start, settling), each.stop) for each in intervals if each.stop > settling),
    )


def velocity_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Return the mean planar velocity error over all steps; after a fall the error is VELOCITY_CAP.

    Args:
        command: Command, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        velocity: Trunk velocity, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        upright: True for control steps before the robot's fall, (steps, n).

    Returns:
        Mean error of each episode, (n,), m/s.
    """
    return total(_capped(planar(command - velocity), upright, VELOCITY_CAP)) / len(upright)


def yaw_rate_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Return the mean yaw-rate error over all control steps; after a fall the error is YAW_RATE_CAP.

    Args:
        command: Command, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        velocity: Trunk velocity, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        upright: True for control steps before the robot's fall, (steps, n).

    Returns:
        Mean error of each episode, (n,), rad/s.
    """
    return total(_capped(np.abs(command[..., 2] - velocity[..., 2]), upright, YAW_RATE_CAP)) / len(upright)


def velocity_error_upright(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Return the mean planar velocity error over the control steps before a fall.

    The error of a step is limited to VELOCITY_CAP.

    Args:
        command: Command, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        velocity: Trunk velocity, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        upright: True for control steps before the robot's fall, (steps, n).

    Returns:
        Mean error of each episode, (n,), m/s; NaN if an episode has no step before a fall.
    """
    return upright_mean(np.minimum(planar(command - velocity), VELOCITY_CAP), upright)


def mean_velocity_error(command: Floats, velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """Return the mean over all command intervals of the planar error ‖command − mean velocity‖.

    The mean velocity of an interval is computed over its control steps before a fall. In the mean, the interval is
    weighted with the number of these steps. Each control step after a fall has the error VELOCITY_CAP.

    Args:
        command: Command, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        velocity: Trunk velocity, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        upright: True for control steps before the robot's fall, (steps, n).
        windows: Slices of the control steps, one for each interval of constant command.

    Returns:
        Mean error of each episode, (n,), m/s.
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
    """Return the velocity command of each interval of constant command.

    Args:
        command: Command, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        upright: True for control steps before the robot's fall, (steps, n).
        starts: First control step of each of the k intervals.

    Returns:
        Commands in the heading frame, (n, k, 3). The components are forward and lateral velocity, m/s, and yaw rate,
        rad/s. They are NaN if the robot had fallen before the start of the interval.
    """
    return np.stack([np.where(upright[start, :, None], command[start], np.nan) for start in starts], axis=1)


def mean_velocities(velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """Return the mean velocity in each of k windows of control steps.

    Args:
        velocity: Trunk velocity, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        upright: True for control steps before the robot's fall, (steps, n).
        windows: k slices of the control steps.

    Returns:
        Mean velocities in the heading frame, (n, k, 3). The components are forward and lateral velocity, m/s, and yaw
        rate, rad/s. They are NaN if the robot had fallen before the end of the window.
    """
    means = [
        np.where(upright[window.stop - 1, :, None], window_mean(velocity, upright, window), np.nan)
        for window in windows
    ]
    return np.stack(means, axis=1)


def distance_covered(velocity: Floats, upright: Bools, stretches: tuple[slice, ...], dt: float) -> Floats:
    """Return the covered distance: the sum over command intervals of ‖mean velocity‖ × time before a fall.

    Args:
        velocity: Trunk velocity, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        upright: True for control steps before the robot's fall, (steps, n).
        stretches: Slices of the control steps, one for each command interval.
        dt: Duration of a control step, s.

    Returns:
        Distance of each episode, (n,), m.
    """
    covered = [planar(total(np.where(upright[stretch, :, None], velocity[stretch], 0.0))) * dt for stretch in stretches]
    return np.asarray(np.add.reduce(covered))


def window_mean(velocity: Floats, upright: Bools, window: slice) -> Floats:
    """Return the mean velocity over the control steps of a window that are before a fall.

    Args:
        velocity: Trunk velocity, heading frame, (steps, n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        upright: True for control steps before the robot's fall, (steps, n).
        window: Slice of the control steps.

    Returns:
        Mean velocity in the heading frame, (n, 3). The components are forward and lateral velocity, m/s, and yaw rate,
        rad/s. They are NaN if the robot had fallen before the window.
    """
    mask = upright[window]
    return quotient(total(np.where(over_steps(mask, velocity), velocity[window], 0.0)), mask.sum(0)[:, None])


def _capped(error: Floats, upright: Bools, cap: float) -> Floats:
    """Limit the `error` of each control step to `cap`, and set it to `cap` in all steps after a fall.

    `error`, (steps, n), and `cap` have the same unit. `upright`, (steps, n), is True for the steps before a fall.
    """
    return np.where(upright, np.minimum(error, cap), cap)
