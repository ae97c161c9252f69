"""Velocity response: what is achieved of what is commanded, axis by axis, and the dead zone around zero.

Over command intervals that were ended upright, each with its mean velocity after its first second.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.measures.averages import Floats

AXES = {"forward": "m/s", "lateral": "m/s", "yaw_rate": "rad/s"}
"""Axis of a command -> unit."""
BIN = 0.1
"""Width of the bins of commands, m/s or rad/s."""
RESPONDS = 0.2
"""Share of a command that must be achieved for the robot to respond to it."""


@dataclass(frozen=True)
class Response:
    """Response along one axis; NaN where there are too few intervals."""

    gain: float
    """Slope of the least-squares line of achieved against commanded velocity."""
    offset: float
    """What that line gives at zero command."""
    dead_zone: float
    """Smallest |command|, to a bin, from which on at least RESPONDS of it is achieved in every bin up to the largest;
    inf if not even in that one."""


def responses(commands: Floats, achieved: Floats) -> dict[str, Response]:
    """Response of each axis; commands and mean velocities (…, 3) of intervals, NaN of those that do not count."""
    return {axis: response(*known(commands, achieved, number)) for number, axis in enumerate(AXES)}


def response(command: Floats, achieved: Floats) -> Response:
    """Response in intervals' commands and mean velocities along one axis, (m,)."""
    if len(np.unique(command)) < 2:
        return Response(float("nan"), float("nan"), float("nan"))
    gain, offset = np.polyfit(command, achieved, 1)
    return Response(float(gain), float(offset), dead_zone(command, achieved))


def dead_zone(command: Floats, achieved: Floats) -> float:
    """Lower edge of the lowest bin of |command| from which on every bin that holds something responds."""
    moving = command != 0
    size, along = np.abs(command[moving]), achieved[moving] * np.sign(command[moving])
    if not len(size):
        return float("nan")
    number = np.floor(size / BIN).astype(np.intp)
    asked, got = np.bincount(number, weights=size), np.bincount(number, weights=along)
    idle = np.flatnonzero((asked > 0) & (got < RESPONDS * asked))
    if not len(idle):
        return 0.0
    above = np.flatnonzero(asked[idle[-1] + 1 :])
    return float((idle[-1] + 1 + above[0]) * BIN) if len(above) else float("inf")


def known(commands: Floats, achieved: Floats, axis: int) -> tuple[Floats, Floats]:
    """Commands and mean velocities along that axis, (m,) each, of the intervals that count."""
    asked, got = commands[..., axis].ravel(), achieved[..., axis].ravel()
    counts = np.isfinite(asked) & np.isfinite(got)
    return asked[counts], got[counts]
