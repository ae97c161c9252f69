"""Curves and events of an episode, as JSON values, for a page that shows them next to its film."""

import math
from collections.abc import Iterator, Mapping
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

    def of(name: str) -> Floats:
        return np.asarray(getattr(episodes, name)[:end, 0], np.float64)

    def of_legs(values: Floats) -> dict[str, Floats]:
        return {name.upper(): values[:, leg] for leg, name in enumerate(episodes.robot.leg_names)}

    given = [None] * 4 if episodes.observed is None else as_given(of("observed"))
    motion = zip(MOTION, of("heading_velocity").T, of("command").T, given[1:], strict=True)
    share = 100.0 * of("peak_torque") / np.asarray(episodes.torque_limit)
    lowest = FallRule().lowest(episodes.robot.leg_length)
    return [
        _chart("Feet on the ground", of_legs(of("foot_contact")), bars=True),
        _chart("Tilt, °", {"actual": np.degrees(of("tilt")), "given": given[0]}, limit=math.degrees(FallRule().tilt)),
        _chart("Trunk above ground, m", {"actual": of("height")}, limit=lowest),
        *(_chart(title, {"actual": was, "command": asked, "given": seen}) for title, was, asked, seen in motion),
        _chart("Feet above ground, m", of_legs(of("foot_height")), least=0.05),
        _chart("Largest torque of each leg, % of limit", of_legs(share.reshape(end, 4, -1).max(axis=-1)), limit=100.0),
    ]


def as_given(observed: Floats) -> Floats:
    """Tilt, °, velocity ahead and to the left, m/s, and yaw rate, rad/s, (4, steps), by what alone the policy was
    given, whose vertical is that of the gravity it was given."""
    gravity, turning, velocity = np.split(observed, 3, axis=1)
    up = -gravity / np.maximum(np.linalg.norm(gravity, axis=1), 1e-9)[:, None]
    nose = np.array([1.0, 0.0, 0.0]) - up[:, :1] * up
    nose /= np.maximum(np.linalg.norm(nose, axis=1), 1e-9)[:, None]
    along = ((velocity, nose), (velocity, np.cross(up, nose)), (turning, up))
    tilt = np.degrees(np.arccos(np.clip(up[:, 2], -1.0, 1.0)))
    return np.stack([tilt, *((one * way).sum(axis=1) for one, way in along)])


def events(episodes: Episodes, measures: Measures, end: int) -> Iterator[dict[str, Any]]:
    """Pushes, new commands, the cause and the fall of the first episode's first `end` control steps."""
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


def _chart(title: str, lines: Mapping[str, Floats | None], least: float = 0.5, **more: Any) -> dict[str, Any]:
    known = {
        name: [value if np.isfinite(value) else None for value in signal.round(4).tolist()]
        for name, signal in lines.items()
        if signal is not None
    }
    return {"title": title, "lines": known, "least": least, "limit": None, "bars": False} | more
