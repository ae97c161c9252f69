"""Curves and events of an episode as JSON types, for the HTML page that shows them next to the film."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from evaluate.analysis.results import nan_to_null
from evaluate.measures.averages import Floats
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures

SIGNALS = "foot_contact", "tilt", "height", "heading_velocity", "command", "foot_height"
"""Names of the signals in `Episodes` that the HTML page of an episode draws as curves."""


def curves(episodes: Episodes, end: int) -> dict[str, Any]:
    """Return the signals of the first recorded episode as curves for the HTML page of the episode.

    Args:
        episodes: Recorded episodes.
        end: Number of control steps of the curves.

    Returns:
        Name of a signal, for example `tilt` -> list of its components. A component is a list with its value at the end
        of each control step. `torque_share` has a component for each leg: the largest ratio of torque to torque limit
        among its joints. `given` is tilt and velocity as the policy observes them, from `estimated_state`. The key
        `given` is missing if the observation was not recorded.
    """
    signals = {name: np.asarray(getattr(episodes, name)[:end, 0], np.float64) for name in SIGNALS}
    torque_share = episodes.peak_torque[:end, 0].astype(np.float64) / np.asarray(episodes.torque_limit)
    signals["torque_share"] = torque_share.reshape(end, len(episodes.robot.leg_names), -1).max(axis=-1)
    if episodes.observed is not None:
        signals["given"] = estimated_state(episodes.observed[:end, 0].astype(np.float64))
    columns = {name: values.round(4).reshape(end, -1).T.tolist() for name, values in signals.items()}
    return {name: nan_to_null(lists) for name, lists in columns.items()}


def estimated_state(observed: Floats) -> Floats:
    """Compute tilt and velocity of the trunk from the observation of a policy, which may be noisy.

    The observed direction of gravity determines the heading frame, which is horizontal.

    Args:
        observed: Observed gravity direction (unit vector), angular velocity, rad/s, and linear velocity, m/s, each in
            the base frame, (steps, 9).

    Returns:
        Tilt, rad, forward and leftward velocity, heading frame, m/s, and yaw rate, rad/s, (steps, 4).
    """
    gravity, angular_velocity, velocity = np.split(observed, 3, axis=1)
    up = -gravity / np.maximum(np.linalg.norm(gravity, axis=1), 1e-9)[:, None]
    forward = np.array([1.0, 0.0, 0.0]) - up[:, :1] * up
    forward /= np.maximum(np.linalg.norm(forward, axis=1), 1e-9)[:, None]
    left = np.cross(up, forward)
    tilt = np.arccos(np.clip(up[:, 2], -1.0, 1.0))
    return np.stack(
        [
            tilt,
            (velocity * forward).sum(axis=1),
            (velocity * left).sum(axis=1),
            (angular_velocity * up).sum(axis=1),
        ],
        axis=1,
    )


def events(episodes: Episodes, measures: Measures, end: int) -> Iterator[dict[str, Any]]:
    """Yield the events of the first recorded episode: pushes, new commands, cause of failure, and fall.

    Args:
        episodes: Recorded episodes.
        measures: Measures of these episodes.
        end: Number of control steps on the HTML page; later pushes and commands are left out.

    Yields:
        An event as a dictionary with the keys `kind`, `time` (s) and `words` (description). The dictionary of a push
        also has `until`, the time at which the push ends, s.
    """
    dt = episodes.dt
    for step, impulse in zip(episodes.push_step[0].tolist(), episodes.push_impulse[0], strict=True):
        if step < end:
            words = f"push {np.hypot(*impulse):.0f} N·s"
            yield {"kind": "push", "time": step * dt, "until": (step + episodes.push_steps) * dt, "words": words}
    for step in np.flatnonzero(np.diff(episodes.command[:end, 0], axis=0).any(axis=1)).tolist():
        yield {"kind": "command", "time": (step + 1) * dt, "words": "new command"}
    if (cause := measures.cause[0]) is not None:
        yield {"kind": "cause", "time": float(measures.cause_time[0]), "words": f"cause: {cause.replace('_', ' ')}"}
    if measures.fell[0]:
        words = episodes.fall_reason[0].replace("_", " ")
        yield {"kind": "fall", "time": float(measures.fall_time[0]), "words": f"fell: {words}"}
