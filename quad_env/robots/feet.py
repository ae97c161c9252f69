"""The foot of a leg, found in its compiled model: the lowest geoms that meet the ground, whatever their shape.

Kinematics and terrain take a foot for a ball. A sphere, or the end of a capsule, is one. In a foot of another shape it
is a ball as wide as the thinnest side of the foot, on the middle of the sole; how far the edges reach below this ball
when the leg is tilted is worked out from `points`, see `kinematics.foot_depths`.
"""

from typing import Any, NamedTuple

import numpy as np

from quad_env.robots.shapes import Floats, balls, box, surface

_LEVEL = 1e-3
"""Height above the lowest point up to which another geom is part of the foot too, m."""
_LONG = 0.5
"""Share of the way from the knee to the sole from which on a geom is a shin."""
_FLAT = 0.1
"""Share of the ball's radius above the lowest point up to which points are part of the sole."""
_THICKEST = 0.15
"""Largest radius of the ball in a foot of another shape, as a share of the way from the knee to the sole."""
_DIRECTIONS = np.stack(np.meshgrid(*3 * [np.linspace(-1.0, 1.0, 5)], indexing="ij"), axis=-1).reshape(-1, 3)
_DIRECTIONS = _DIRECTIONS[np.abs(_DIRECTIONS).max(axis=1) == 1.0]


class Foot(NamedTuple):
    """A foot; places in the frame of its body, m."""

    geoms: tuple[int, ...]
    """Ids, the lowest first."""
    body: int
    """Id of the body of the first of them."""
    place: Floats
    """Centre of the ball, (3,)."""
    radius: float
    points: Floats
    """Points of its hull from that centre, (k, 3); of a ball none, (0, 3)."""


def find_foot(model: Any, data: Any, joint: int, candidates: list[int]) -> Foot | None:
    """The foot among geoms of a leg's last link, that below the joint of the knee; None without candidates."""
    if not candidates:
        return None
    knee, axis = data.xanchor[joint], data.xaxis[joint]
    hulls = {geom: in_world(model, data, geom, surface(model, geom)) for geom in candidates}
    farthest = max(candidates, key=lambda geom: np.linalg.norm(hulls[geom] - knee, axis=1).max())
    down = _centre(model, data, farthest, knee) - knee
    down -= (down @ axis) * axis  # a foot may be wide
    down /= np.linalg.norm(down)
    depths = {geom: float(((points - knee) @ down).max()) for geom, points in hulls.items()}
    lowest = max(depths.values())
    level = [geom for geom in candidates if depths[geom] > lowest - _LEVEL]
    short = [geom for geom in level if np.ptp(hulls[geom] @ down) < _LONG * lowest]
    geoms = tuple(sorted(short or level[:1], key=lambda geom: -depths[geom]))
    body = int(model.geom_bodyid[geoms[0]])
    ends = balls(model, geoms[0]) if len(geoms) == 1 else []
    heights = [float((knee - in_world(model, data, geoms[0], place)) @ down) for place, _ in ends]
    if len(ends) == 1 or (ends and np.ptp(heights) > ends[0][1]):  # no capsule that lies across the leg
        return Foot(geoms, body, *ends[int(np.argmin(heights))], np.zeros((0, 3)))
    points = np.concatenate([hulls[geom] for geom in geoms])
    radius = min(float(np.min([box(model, geom)[1].min() for geom in geoms])), _THICKEST * lowest)
    centre = _sole(points, knee, down, _FLAT * radius) - radius * down
    axes = data.xmat[body].reshape(3, 3)
    hull = (points - centre) @ axes
    return Foot(geoms, body, (centre - data.xpos[body]) @ axes, radius, hull)


def extremes(points: Floats) -> Floats:
    """Of these points, (k, 3), the farthest in each of many directions, (m, 3): as many for every foot."""
    found: Floats = points[(points @ _DIRECTIONS.T).argmax(axis=0)] if len(points) else points
    return found


def depths(points: Floats, angles: Floats, up: Floats) -> Floats:
    """Lowest points of feet below their centres, (...,), m, from points of their hulls in the base frame with the legs
    straight down, (..., k, 3), joint angles, (..., 3), rad, and the vertical in the base frame, (..., 3)."""
    x, y, z = np.moveaxis(points, -1, 0)
    hip, shin = angles[..., 0, None], angles[..., 1, None] + angles[..., 2, None]
    ahead, down = np.cos(shin) * x + np.sin(shin) * z, np.cos(shin) * z - np.sin(shin) * x
    left, above = np.cos(hip) * y - np.sin(hip) * down, np.sin(hip) * y + np.cos(hip) * down
    lowest: Floats = (up[..., 0, None] * ahead + up[..., 1, None] * left + up[..., 2, None] * above).min(axis=-1)
    return -lowest


def _sole(points: Floats, knee: Floats, down: Floats, slack: float) -> Floats:
    """Middle of the lowest points, in a frame whose `down` is a unit vector; all in the world frame, m."""
    depths = (points - knee) @ down
    low = points[depths > depths.max() - slack]
    flat = low - np.outer((low - knee) @ down, down)
    middle: Floats = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    return middle + float(depths.max()) * down


def _centre(model: Any, data: Any, geom: int, knee: Floats) -> Floats:
    """Centre of the lower end of a capsule or of a sphere, of the box around any other shape, world frame, m."""
    places = [place for place, _ in balls(model, geom)] or [box(model, geom)[0]]
    return max((in_world(model, data, geom, place) for place in places), key=lambda at: np.linalg.norm(at - knee))


def in_world(model: Any, data: Any, geom: int, points: Floats) -> Floats:
    """Points of a geom's body, (..., 3), in the world frame."""
    body = int(model.geom_bodyid[geom])
    return np.asarray(data.xpos[body] + points @ data.xmat[body].reshape(3, 3).T)
