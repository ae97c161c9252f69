"""Foot of a leg in its compiled model: the geoms of the last link that can carry the robot in a stance.

Kinematics and terrain model a foot as a ball: a sphere, or the end of a capsule. For several geoms or another shape,
the ball has the width of the thinnest side and lies on the middle of the sole. `points` and `radii` give the depth of
the foot below this ball when the leg is tilted, see `kinematics.foot_depths`.

A geom belongs to the foot if it is the lowest in one pose of a stance: the link is tilted about the axis of the knee
and about the leg's x axis, see `standing_geoms`.
"""

from typing import Any, NamedTuple

import numpy as np

from quad_env.robots.shapes import Floats, bounding_box, end_spheres, rounded_hull, surface_points

_LEVEL = 1e-3
"""Height above the lowest point up to which another geom is part of the foot too, m."""
_LONG = 0.5
"""Share of the way from the knee to the sole from which on a geom is a shin."""
_FLAT = 0.1
"""Share of the ball's radius above the lowest point up to which points are part of the sole."""
_THICKEST = 0.15
"""Largest radius of the ball in a foot of another shape, as a share of the way from the knee to the sole."""
_REACH = 0.9
"""Least distance from the knee of a geom at the leg's end, as a share of the farthest geom's."""
_SOFT = 5e-3
"""m. Height above the lowest point up to which a short geom is part of the foot: contacts yield."""
SWING = 0.3
"""rad. Largest tilt of a shin in a stance beyond that of standing."""
LEAST_BENT = 0.8
"""rad. Lower bound on the estimated largest tilt of a shin in a stance with a bent knee."""
MOST_BENT = 1.0
"""rad. Upper bound on the same tilt."""
_ROLL = 0.4
"""rad. Largest tilt of a shin in a stance to either side."""
_BALL = 1e-4
"""m. Depth below the foot's ball up to which other geoms do not count."""
_DIRECTIONS = np.stack(np.meshgrid(*3 * [np.linspace(-1.0, 1.0, 9)], indexing="ij"), axis=-1).reshape(-1, 3)
_DIRECTIONS = _DIRECTIONS[np.abs(_DIRECTIONS).max(axis=1) == 1.0]
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
_AROUND, _ASIDE = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False), np.linspace(-0.4, 0.4, 9))
_PITCHED = np.cos(_ASIDE) * np.sin(_AROUND), np.sin(_ASIDE), -np.cos(_ASIDE) * np.cos(_AROUND)
_DIRECTIONS = np.concatenate((_DIRECTIONS, np.stack(_PITCHED, axis=-1).reshape(-1, 3)))
"""Unit vectors in all directions, denser in the leg plane, where a tilted shin may be lowest."""


class Foot(NamedTuple):
    """A foot; places in the frame of its body, m."""

    geoms: tuple[int, ...]
    """Ids, the lowest first."""
    body: int
    """Id of the body of the first of them."""
    centre: Floats
    """Centre of the ball, (3,)."""
    radius: float
    points: Floats
    """Points from that centre, (k, 3), m; (0, 3) for a ball. The foot is their hull, each grown by its radius."""
    radii: Floats
    """Radii about the points, (k,), m."""

    def bodies(self, model: Any) -> list[int]:
        """Return the ids of the bodies that have its geoms, `body` first."""
        return list(dict.fromkeys(int(model.geom_bodyid[geom]) for geom in self.geoms))


def find_foot(model: Any, data: Any, joint: int, candidates: list[int]) -> Foot | None:
    """Return the lowest geoms of a leg's last link in the straight leg, as a foot.

    Args:
        model: Compiled model.
        data: Its state, with the kinematics of `qpos0`.
        joint: Id of the knee's joint.
        candidates: Ids of the geoms of the link that meet the ground.

    Returns:
        The foot; None without candidates, or where all of them lie at the joint.
    """
    if not candidates:
        return None
    knee = data.xanchor[joint]
    hulls = {geom: geom_points_to_world(model, data, geom, surface_points(model, geom)) for geom in candidates}
    down = _down(model, data, joint, hulls)
    if down is None:
        return None
    depths = {geom: float(((points - knee) @ down).max()) for geom, points in hulls.items()}
    lowest = max(depths.values())
    level = [geom for geom in candidates if depths[geom] >= lowest - _LEVEL]
    short = [geom for geom in level if np.ptp(hulls[geom] @ down) < _LONG * lowest]
    geoms = tuple(sorted(short or level, key=lambda geom: -depths[geom]))
    body = int(model.geom_bodyid[geoms[0]])
    ends = end_spheres(model, geoms[0]) if len(geoms) == 1 else []
    heights = [float((knee - geom_points_to_world(model, data, geoms[0], place)) @ down) for place, _ in ends]
    if len(ends) == 1 or (ends and np.ptp(heights) > ends[0][1]):  # no capsule that lies across the leg
        return Foot(geoms, body, *ends[int(np.argmin(heights))], np.zeros((0, 3)), np.zeros(0))
    points = np.concatenate([hulls[geom] for geom in geoms])
    radius = min(float(np.min([bounding_box(model, geom)[1].min() for geom in geoms])), _THICKEST * lowest)
    centre = _sole(points, knee, down, _FLAT * radius) - radius * down
    axes = data.xmat[body].reshape(3, 3)
    return _with_points(model, data, Foot(geoms, body, (centre - data.xpos[body]) @ axes, radius, points, np.zeros(0)))


def standing_foot(
    model: Any, data: Any, joint: int, candidates: list[int], foot: Foot, tilts: tuple[float, float]
) -> Foot:
    """Add to a foot the geoms of its link that are the lowest in another pose of a stance.

    Args:
        model: Compiled model.
        data: Its state, with the kinematics of `qpos0`.
        joint: Id of the knee's joint.
        candidates: Ids of the geoms of the link that meet the ground.
        foot: The foot of the straight leg, see `find_foot`.
        tilts: Least and largest tilt of the shin about the joint's axis in a stance, rad.

    Returns:
        The same ball with all geoms that touch; `foot` itself where its ball is the lowest in every pose.
    """
    knee = data.xanchor[joint]
    axis = data.xaxis[joint]
    shapes = {geom: rounded_hull(model, geom) for geom in candidates}
    hulls = {
        geom: (geom_points_to_world(model, data, geom, points), radius) for geom, (points, radius) in shapes.items()
    }
    centre = body_points_to_world(data, foot.body, foot.centre)
    down = centre - knee
    down -= (down @ axis) * axis
    down /= np.linalg.norm(down)
    ways = _stance(down, axis, tilts)
    reach = {geom: ((points - knee) @ ways.T).max(axis=0) + radius for geom, (points, radius) in hulls.items()}
    lowest = np.max(list(reach.values()), axis=0)
    length = float(np.linalg.norm(centre - knee)) + foot.radius
    slack = {geom: _SOFT if _is_short(hulls[geom][0], down, length) else _LEVEL for geom in candidates}
    members = {geom for geom in candidates if (reach[geom] >= lowest - slack[geom]).any()}
    if not members.difference(foot.geoms):
        return foot
    geoms = (*foot.geoms, *sorted(members.difference(foot.geoms), key=lambda geom: -float(reach[geom].max())))
    ball = (centre - knee) @ ways.T + foot.radius
    if not foot.points.size and (lowest < ball + _BALL).all():
        return foot._replace(geoms=geoms)
    return _with_points(model, data, foot._replace(geoms=geoms))


def _down(model: Any, data: Any, joint: int, hulls: dict[int, Floats]) -> Floats | None:
    """Return the direction from the knee to the middle of the end geoms, in the leg plane, world frame, (3,). None
    where the geoms lie at the joint.
    """
    knee = data.xanchor[joint]
    axis = data.xaxis[joint]
    distances = {geom: float(np.linalg.norm(points - knee, axis=1).max()) for geom, points in hulls.items()}
    farthest = max(distances, key=lambda geom: distances[geom])
    down = _flat(_centre(model, data, farthest, knee) - knee, axis)  # a foot may be wide
    if down is None:
        return None
    at_end = [geom for geom, distance in distances.items() if distance > _REACH * distances[farthest]]
    at_end = [geom for geom in at_end if np.ptp(hulls[geom] @ down) < _LONG * distances[farthest]]
    if len(at_end) == 0 or (len(at_end) == 1 and _is_ball(model, at_end[0], hulls[at_end[0]], down)):
        return down
    points = np.concatenate([hulls[geom] for geom in at_end]) - knee
    for _ in range(4):  # each turn of the frame moves the middle less
        ahead = np.cross(axis, down)
        along = points @ down
        across = points @ ahead
        turned = _flat(along.max() * down + 0.5 * (across.min() + across.max()) * ahead, axis)
        assert turned is not None
        down = turned
    return down


def _is_ball(model: Any, geom: int, hull: Floats, down: Floats) -> bool:
    """Return whether the lower end of a geom is that of a sphere or of a capsule that does not lie across the leg."""
    ends = end_spheres(model, geom)
    return len(ends) == 1 or (len(ends) == 2 and float(np.ptp(hull @ down)) > 3.0 * ends[0][1])


def _flat(vector: Floats, axis: Floats) -> Floats | None:
    """Return the direction of a vector across an axis, unit length, (3,); None for a vector along the axis."""
    across = vector - (vector @ axis) * axis
    length = float(np.linalg.norm(across))
    if length < 1e-6:
        return None
    found: Floats = across / length
    return found


def _is_short(points: Floats, down: Floats, length: float) -> bool:
    """Return whether a geom is no shin: its extent along the leg is less than half of the leg's length."""
    return float(np.ptp(points @ down)) < _LONG * length


def _stance(down: Floats, axis: Floats, tilts: tuple[float, float]) -> Floats:
    """Return the directions of gravity in a stance for a leg that is straight down at `down`, world frame, (k, 3)."""
    pitches = np.linspace(*tilts, 27)
    rolls = np.linspace(-_ROLL, _ROLL, 9)
    pitch, roll = (each.reshape(-1, 1) for each in np.meshgrid(pitches, rolls))
    ahead = np.cross(axis, down)
    found: Floats = np.cos(roll) * (np.cos(pitch) * down - np.sin(pitch) * ahead) + np.sin(roll) * axis
    return found


def _with_points(model: Any, data: Any, foot: Foot) -> Foot:
    """Return the foot with the points and radii of its geoms."""
    shapes = [(geom, *rounded_hull(model, geom)) for geom in foot.geoms]
    points = np.concatenate([geom_points_to_world(model, data, geom, points) for geom, points, _ in shapes])
    radii = np.concatenate([np.full(len(points), radius) for _, points, radius in shapes])
    axes = data.xmat[foot.body].reshape(3, 3)
    return foot._replace(points=(points - body_points_to_world(data, foot.body, foot.centre)) @ axes, radii=radii)


def extreme_points(points: Floats, radii: Floats) -> tuple[Floats, Floats]:
    """Drop the points that are the farthest in no sampled direction, and add those straight below a round end.

    Args:
        points: (k, 3), m.
        radii: About the points, (k,), m.

    Returns:
        points: Those that are left, (m, 3), m; the lowest of them is the sole of the straight leg.
        radii: About them, (m,), m.
    """
    if not len(points):
        return points, radii
    kept = np.unique((points @ _DIRECTIONS.T + radii[:, None]).argmax(axis=0))
    points = points[kept]
    radii = radii[kept]
    round_ends = radii > 0.0
    below = points[round_ends] - radii[round_ends, None] * (0.0, 0.0, 1.0)
    return np.concatenate((points, below)), np.concatenate((radii, np.zeros(len(below))))


def depths_below_centre(points: Floats, radii: Floats, angles: Floats, up: Floats) -> Floats:
    """Return the depths of feet below their centres, (...,), m.

    Args:
        points: Of the feet, base frame with the legs straight down, (..., k, 3), m.
        radii: About the points, (..., k), m.
        angles: Joint angles of the legs, (..., 3), rad.
        up: The vertical in the base frame, (..., 3).
    """
    x, y, z = np.moveaxis(points, -1, 0)
    hip, shin = angles[..., 0, None], angles[..., 1, None] + angles[..., 2, None]
    ahead, down = np.cos(shin) * x + np.sin(shin) * z, np.cos(shin) * z - np.sin(shin) * x
    left, above = np.cos(hip) * y - np.sin(hip) * down, np.sin(hip) * y + np.cos(hip) * down
    heights = up[..., 0, None] * ahead + up[..., 1, None] * left + up[..., 2, None] * above
    lowest: Floats = (heights - radii).min(axis=-1)
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
    places = [place for place, _ in end_spheres(model, geom)] or [bounding_box(model, geom)[0]]
    return max(
        (geom_points_to_world(model, data, geom, place) for place in places), key=lambda at: np.linalg.norm(at - knee)
    )


def geom_points_to_world(model: Any, data: Any, geom: int, points: Floats) -> Floats:
    """Points of a geom's body, (..., 3), in the world frame."""
    return body_points_to_world(data, int(model.geom_bodyid[geom]), points)


def body_points_to_world(data: Any, body: int, points: Floats) -> Floats:
    """Transform points of a body, (..., 3), m, to the world frame.

    Args:
        data: `mujoco.MjData` with kinematics.
        body: Id of the body.
        points: Body frame, (..., 3), m.
    """
    return np.asarray(data.xpos[body] + points @ data.xmat[body].reshape(3, 3).T)
