"""Curves and events of an episode, as JSON values, for a page that shows them under its film."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from evaluate.measures.averages import Floats
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures
from quad_env.config import FallRule

MOTION = "Velocity forward, m/s", "Velocity left, m/s", "Yaw rate, rad/s"


def charts(episodes: Episodes, end: int) -> list[dict[str, Any]]:
    """Charts of the first episode's first `end` control steps: title, lines with a value a step (that of the reading
    after it), the least range of the scale, a limit, and whether the lines are bars of truth values."""
    robot, limit = episodes.robot, np.asarray(episodes.torque_limit)
    legs, rule = [name.upper() for name in robot.leg_names], FallRule()
    given = None if episodes.observed is None else as_given(_of(episodes, "observed", end))
    command, velocity = _of(episodes, "command", end), _of(episodes, "heading_velocity", end)
    share = 100.0 * (_of(episodes, "peak_torque", end) / limit).reshape(end, len(legs), -1).max(axis=-1)
    tilt, height = _of(episodes, "tilt", end), _of(episodes, "height", end)
    speeds = (
        _chart(title, _lines(given, axis + 1, actual=velocity[:, axis], command=command[:, axis]))
        for axis, title in enumerate(MOTION)
    )
    return [
        _chart("Feet on the ground", _of_legs(legs, _of(episodes, "foot_contact", end)), bars=True),
        _chart("Tilt, rad", _lines(given, 0, actual=tilt), 0.2, limit=rule.tilt),
        _chart("Trunk above ground, m", _lines(actual=height), 0.1, limit=rule.lowest(robot.leg_length)),
        *speeds,
        _chart("Feet above ground, m", _of_legs(legs, _of(episodes, "foot_height", end)), 0.05),
        _chart("Largest torque of each leg, % of limit", _of_legs(legs, share), 100.0, limit=100.0),
    ]


def as_given(observed: Floats) -> Floats:
    """Tilt, rad, velocity ahead and to the left, m/s, and yaw rate, rad/s, by what alone the policy was given, whose
    vertical is that of the gravity it was given, (steps, 4)."""
    gravity, turning, velocity = (observed[:, first : first + 3] for first in (0, 3, 6))
    up = -gravity / np.maximum(np.linalg.norm(gravity, axis=1), 1e-9)[:, None]
    nose = np.array([1.0, 0.0, 0.0]) - up[:, :1] * up
    nose /= np.maximum(np.linalg.norm(nose, axis=1), 1e-9)[:, None]
    tilt = np.arccos(np.clip(up[:, 2], -1.0, 1.0))
    along = ((velocity, nose), (velocity, np.cross(up, nose)), (turning, up))
    return np.stack([tilt, *((one * way).sum(axis=1) for one, way in along)], axis=1)


def events(episodes: Episodes, measures: Measures, end: int) -> Iterator[dict[str, Any]]:
    """Pushes, new commands, the cause and the fall of the first episode's first `end` control steps."""
    dt = episodes.dt
    for step, impulse in zip(episodes.push_step[0].tolist(), episodes.push_impulse[0], strict=True):
        if step < end:
            words = f"push {np.hypot(*impulse):.0f} N·s"
            yield {"kind": "push", "time": step * dt, "until": (step + episodes.push_steps) * dt, "words": words}
    for step in np.flatnonzero(np.diff(episodes.command[:end, 0], axis=0).any(axis=1)) + 1:
        yield {"kind": "command", "time": int(step) * dt, "words": "new command"}
    if measures.cause[0] is not None:
        words = f"cause: {measures.cause[0].replace('_', ' ')}"
        yield {"kind": "cause", "time": float(measures.cause_time[0]), "words": words}
    if measures.fell[0]:
        yield {"kind": "fall", "time": float(measures.fall_time[0]), "words": f"fell: {episodes.fall_reason[0]}"}


def _of(episodes: Episodes, name: str, end: int) -> Floats:
    return np.asarray(getattr(episodes, name)[:end, 0], np.float64)


def _lines(given: Floats | None = None, column: int = 0, **lines: Floats) -> list[dict[str, Any]]:
    """Lines by their names, and what the policy was given."""
    known = lines if given is None else lines | {"given": given[:, column]}
    names = {"given": "given to the policy"}
    return [_line(names.get(look, look), look, values) for look, values in known.items()]


def _of_legs(legs: Sequence[str], values: Floats) -> list[dict[str, Any]]:
    """A line a leg of values (steps, legs)."""
    return [_line(name, f"foot-{place}", values[:, place]) for place, name in enumerate(legs)]


def _line(name: str, look: str, values: Floats) -> dict[str, Any]:
    rounded = [value if np.isfinite(value) else None for value in values.round(4).tolist()]
    return {"name": name, "look": look, "values": rounded}


def _chart(title: str, lines: Sequence[Any], least: float = 0.5, **more: Any) -> dict[str, Any]:
    return {"title": title, "lines": lines, "least": least, "limit": None, "bars": False} | more
