"""Metrics of episodes, each a pure function over (steps, n) arrays; all in the heading frame.

They look at the control steps after an episode's first second. A step is *upright* if its reading was taken before the
robot fell or diverged. Every other step, up to the time limit, is billed the cap of the metric, so that a fall never
makes an error smaller.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.rollout import Episodes

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SETTLING_TIME = 1.0
"""Start of an episode, and of each command interval for the mean velocity, that is not judged, s."""
VELOCITY_CAP = 2.0
"""Largest planar velocity error that a step is billed, m/s; also what a step after a fall costs."""
YAW_RATE_CAP = 3.0
"""Largest yaw-rate error that a step is billed, rad/s; also what a step after a fall costs."""
SHORTEST_DISTANCE = 1.0
"""Below this distance an episode has no cost of transport, m: it would be a quotient by nearly nothing."""


@dataclass(frozen=True)
class Measures:
    """What n episodes measured; one entry an episode, NaN where a measure does not exist."""

    fell: Bools
    """Fell or diverged before the time limit, (n,); a time-out is not a fall."""
    diverged: Bools
    """The simulation diverged, (n,)."""
    fall_time: Floats
    """From the start to the fall, (n,) s; NaN without a fall."""
    velocity_error: Floats
    """Mean of ‖command − planar velocity‖, a step capped and billed at 2 m/s, (n,) m/s."""
    yaw_rate_error: Floats
    """Mean of |command − yaw rate|, a step capped and billed at 3 rad/s, (n,) rad/s."""
    mean_velocity_error: Floats
    """‖command − mean velocity‖ of the command intervals, capped and billed at 2 m/s, (n,) m/s."""
    velocity_error_upright: Floats
    """velocity_error over the upright steps alone, (n,) m/s; NaN after a fall within the first second."""
    energy: Floats
    """Integral of Σ|torque · joint speed| over the upright steps, (n,) J."""
    distance: Floats
    """Σ ‖mean velocity‖ · time of the command intervals, same steps, (n,) m; swaying in place covers none."""
    cost_of_transport: Floats
    """energy / (weight · distance), (n,); NaN for an episode that covered less than SHORTEST_DISTANCE."""
    overspeed: Floats
    """Share of joints and time above the rated joint speed, over the upright steps, (n,)."""
    commands: Floats
    """Command of each interval, (n, k, 3) m/s, m/s, rad/s; NaN where it was not upright to begin it."""
    mean_velocities: Floats
    """Mean heading velocity of each interval, (n, k, 3) m/s, m/s, rad/s; NaN where it was not upright to its end."""


def measure(episodes: Episodes) -> Measures:
    """Every measure of a set of episodes."""
    settling_steps = round(SETTLING_TIME / episodes.dt)
    settled = slice(settling_steps, None)
    upright = upright_steps(episodes.fall_step, episodes.steps)
    command, velocity = episodes.command, episodes.heading_velocity
    intervals = command_intervals(episodes.steps, episodes.command_steps)
    windows = tuple(slice(i.start + settling_steps, i.stop) for i in intervals if i.stop - i.start > settling_steps)
    fell = episodes.fall_step < episodes.steps
    energy = _total(np.where(upright, episodes.mechanical_power, 0.0)[settled]) * episodes.dt
    stretches = tuple(slice(max(i.start, settling_steps), i.stop) for i in intervals if i.stop > settling_steps)
    distance = distance_covered(velocity, upright, stretches, episodes.dt)
    return Measures(
        fell=fell,
        diverged=episodes.diverged,
        fall_time=np.where(fell, (episodes.fall_step + 1) * episodes.dt, np.nan),
        velocity_error=velocity_error(command[settled], velocity[settled], upright[settled]),
        yaw_rate_error=yaw_rate_error(command[settled], velocity[settled], upright[settled]),
        mean_velocity_error=mean_velocity_error(command, velocity, upright, windows),
        velocity_error_upright=velocity_error_upright(command[settled], velocity[settled], upright[settled]),
        energy=energy,
        distance=distance,
        cost_of_transport=cost_of_transport(energy, distance, episodes.weight),
        overspeed=upright_mean(episodes.overspeed[settled], upright[settled]),
        commands=commands_given(command, upright, tuple(window.start - settling_steps for window in windows)),
        mean_velocities=mean_velocities(velocity, upright, windows),
    )


def summarise(episodes: Episodes) -> dict[str, float]:
    """Plain means over a set of episodes, name -> value: what training validates with."""
    measures = measure(episodes)
    return {
        "fall_rate": float(measures.fell.mean()),
        "diverged_rate": float(measures.diverged.mean()),
        "velocity_error": float(measures.velocity_error.mean()),
        "yaw_rate_error": float(measures.yaw_rate_error.mean()),
        "mean_velocity_error": float(measures.mean_velocity_error.mean()),
    }


def upright_steps(fall_step: NDArray[np.int64], steps: int) -> Bools:
    """Whether each step's reading was taken before the fall, (steps, n)."""
    upright: Bools = np.arange(steps)[:, None] < fall_step
    return upright


def command_intervals(steps: int, command_steps: int) -> tuple[slice, ...]:
    """Steps of each command interval; a command lasts `command_steps`."""
    return tuple(slice(start, min(start + command_steps, steps)) for start in range(0, steps, command_steps))


def velocity_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Mean planar velocity error of all given steps, billed after a fall, (n,) m/s."""
    return _total(_billed(_planar(command - velocity), upright, VELOCITY_CAP)) / len(upright)


def yaw_rate_error(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Mean yaw-rate error of all given steps, billed after a fall, (n,) rad/s."""
    return _total(_billed(np.abs(command[..., 2] - velocity[..., 2]), upright, YAW_RATE_CAP)) / len(upright)


def velocity_error_upright(command: Floats, velocity: Floats, upright: Bools) -> Floats:
    """Mean capped planar velocity error of the upright steps alone, (n,) m/s; NaN where there is none."""
    return upright_mean(np.minimum(_planar(command - velocity), VELOCITY_CAP), upright)


def upright_mean(values: Floats, upright: Bools) -> Floats:
    """Mean over the upright steps alone, (n,); NaN where there is none."""
    return _quotient(_total(np.where(upright, values, 0.0)), upright.sum(axis=0))


def mean_velocity_error(command: Floats, velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """‖command − mean velocity‖ of each window, averaged over the windows' steps, (n,) m/s.

    The mean is taken over a window's upright steps, and its error is what each of those is billed.
    """
    total, steps = np.zeros(upright.shape[1]), 0
    for window in windows:
        error = _planar(command[window.start] - _window_mean(velocity, upright, window))
        standing = upright[window].sum(axis=0)
        length = window.stop - window.start
        total += np.where(standing > 0, np.minimum(error, VELOCITY_CAP) * standing, 0.0)
        total += VELOCITY_CAP * (length - standing)
        steps += length
    return total / steps


def commands_given(command: Floats, upright: Bools, starts: tuple[int, ...]) -> Floats:
    """Commands at the starts of the intervals, (n, k, 3); NaN where the robot was not upright any more."""
    return np.stack([np.where(upright[start, :, None], command[start], np.nan) for start in starts], axis=1)


def mean_velocities(velocity: Floats, upright: Bools, windows: tuple[slice, ...]) -> Floats:
    """Mean heading velocity over each window, (n, k, 3); NaN where the robot was not upright to the window's end."""
    means = [
        np.where(upright[window.stop - 1, :, None], _window_mean(velocity, upright, window), np.nan)
        for window in windows
    ]
    return np.stack(means, axis=1)


def distance_covered(velocity: Floats, upright: Bools, stretches: tuple[slice, ...], dt: float) -> Floats:
    """Distance along the mean heading velocity of each stretch, upright steps, (n,) m."""
    covered = [
        _planar(np.where(upright[stretch, :, None], velocity[stretch], 0.0).sum(axis=0)) * dt for stretch in stretches
    ]
    total: Floats = np.sum(covered, axis=0)
    return total


def cost_of_transport(energy: Floats, distance: Floats, weight: float) -> Floats:
    """Energy over weight times distance; NaN below SHORTEST_DISTANCE."""
    return np.where(distance < SHORTEST_DISTANCE, np.nan, energy / (weight * np.maximum(distance, SHORTEST_DISTANCE)))


def _planar(vectors: Floats) -> Floats:
    norm: Floats = np.hypot(vectors[..., 0], vectors[..., 1])
    return norm


def _billed(error: Floats, upright: Bools, cap: float) -> Floats:
    return np.where(upright, np.minimum(error, cap), cap)


def _total(values: Floats) -> Floats:
    """Sum over the steps of (steps, n), each episode's laid out in a row: the same bits alone and in any batch."""
    total: Floats = np.ascontiguousarray(values.T).sum(axis=-1)
    return total


def _window_mean(velocity: Floats, upright: Bools, window: slice) -> Floats:
    """Mean over a window's upright steps, (n, 3); NaN where there is none."""
    standing = upright[window]
    total = np.where(standing[..., None], velocity[window], 0.0).sum(axis=0)
    return _quotient(total, standing.sum(axis=0)[:, None])


def _quotient(total: Floats, count: NDArray[np.int64]) -> Floats:
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
