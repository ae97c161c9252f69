"""Detection of the feet in a user's model: geoms of a leg's last link that can carry the standing robot.

The kinematics and the terrain model a foot as a ball. If the foot is a single sphere, the ball is this sphere. If the
foot is a single capsule, the ball is its lower end. For another shape or several geoms, the diameter of the ball is at
most the thickness of the thinnest geom, and the ball touches the middle of the sole. `points` and `radii` of a `Foot`
then describe the exact shape; `kinematics.foot_depths` uses them.

A geom belongs to the foot if it is the lowest geom in at least one pose of a standing robot. In these poses the shin
is tilted about the axis of the knee and about the leg's x axis, see `extend_foot`.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from quad_env.robots.shapes import Floats, bounding_box, end_spheres, rounded_hull, surface_points


@dataclass(frozen=True)
class StanceTilts:
    """Tilts of the shin in a stance; a geom that touches the ground at one of these tilts is part of the foot."""

    margin: float = 0.3
    """Difference between the largest shin tilt in stance and the largest shin tilt in the keyframes, rad.

    This number is also the largest shin tilt in the direction in which the knee does not bend.
    """
    min_bent: float = 0.8
    """Lower bound of the largest shin tilt in stance, in the direction in which the knee bends, rad.

    If the tilt that is computed from the model's keyframes is smaller, this bound replaces it.
    """
    max_bent: float = 1.0
    """Upper bound of the largest shin tilt in stance, in the direction in which the knee bends, rad.

    If the tilt that is computed from the model's keyframes is larger, this bound replaces it.
    """
    max_roll: float = 0.4
    """Largest tilt of the shin to the left and to the right, rad."""


@dataclass(frozen=True)
class FootThresholds:
    """Thresholds that decide which geoms of a leg's last link are the foot and which are the shin."""

    level: float = 1e-3
    """Largest distance between a geom and the ground at which the geom counts as touching it, m.

    The ground is assumed to be at the lowest point of all geoms of the link.
    """
    short_level: float = 5e-3
    """Replacement of the threshold `level` for a geom that is too short for a shin, in poses with a tilted shin, m.

    The threshold is larger than `level` because contacts yield under load.
    """
    ball_depth: float = 1e-4
    """Largest depth of foot geoms below the foot's ball at which the ball alone represents the foot, m.

    The depth is measured for the geoms that `extend_foot` adds to the foot.
    """
    shin_length: float = 0.5
    """Smallest length of a geom along the leg at which it is a shin, as a fraction of the knee-sole distance."""
    sole_height: float = 0.1
    """Largest height of a point of the sole above the lowest point of the foot, as a fraction of the ball's radius."""
    max_radius: float = 0.15
    """Largest radius of the ball that models a foot, as a fraction of the knee-sole distance.

    The limit applies to feet that are not a single sphere or capsule.
    """
    end_distance: float = 0.9
    """Smallest distance from the knee at which a geom belongs to the leg's end, dimensionless.

    It is a fraction of the distance between the knee and the farthest point of the leg's last link. The distance of a
    geom is measured at its farthest point.
    """
    min_vector: float = 1e-6
    """Smallest length of a vector with a defined direction, m; shorter vectors are treated as zero."""


STANCE_TILTS = StanceTilts()
_THRESHOLDS = FootThresholds()
_MIDDLE_ITERATIONS = 4
"""Number of iterations in which `_middle_direction` refines the direction from the knee to the foot's middle."""


def _sample_directions() -> Floats:
    """Return k unit vectors that sample all directions, base frame with the leg straight down, (k, 3).

    `extreme_points` keeps the points of a foot that are extreme in one of these directions. The vectors are denser near
    the plane in which the leg bends, because the lowest point of a tilted shin lies in a direction near this plane.
    """
    grid = np.stack(np.meshgrid(*3 * [np.linspace(-1.0, 1.0, 9)], indexing="ij"), axis=-1).reshape(-1, 3)
    surface = grid[np.abs(grid).max(axis=1) == 1.0]
    surface /= np.linalg.norm(surface, axis=1, keepdims=True)
    pitch, roll = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False), np.linspace(-0.4, 0.4, 9))
    in_plane = (np.cos(roll) * np.sin(pitch), np.sin(roll), -np.cos(roll) * np.cos(pitch))
    return np.concatenate((surface, np.stack(in_plane, axis=-1).reshape(-1, 3)))


_DIRECTIONS = _sample_directions()


class Foot(NamedTuple):
    """Geoms and shape of a leg's foot in a compiled model; made by `find_foot` and extended by `extend_foot`."""

    geoms: tuple[int, ...]
    """Ids of the foot geoms in the compiled model, the geom that reaches lowest first."""
    body: int
    """Id of the body with the first foot geom; `centre` and `points` are in the frame of this body."""
    centre: Floats
    """Centre of the ball that models the foot in the kinematics, frame of `body`, (3,), m."""
    radius: float
    """Radius of the ball that models the foot in the kinematics, m."""
    points: Floats
    """Positions of k points that describe the shape of the foot, relative to `centre`, frame of `body`, (k, 3), m.

    The foot is the convex hull of balls about these points, with the radii in `radii`. k is 0 if the foot is one ball.
    """
    radii: Floats
    """Radius of the ball about each of the k points in `points`, (k,), m; 0 at a corner or edge of the foot."""

    def bodies(self, model: Any) -> list[int]:
        """Return the ids of all bodies that have foot geoms in the compiled `model`; `self.body` is the first."""
        return list(dict.fromkeys(int(model.geom_bodyid[geom]) for geom in self.geoms))


def find_foot(model: Any, data: Any, joint: int, candidates: list[int]) -> Foot | None:
    """Find the foot of a leg as if the leg pointed straight down: the geoms of its last link that reach lowest.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        joint: Id of the knee joint.
        candidates: Ids of the geoms of the leg's last link that collide with the ground.

    Returns:
        The foot; None if `candidates` is empty, or if all of these geoms lie at the knee.
    """
    if not candidates:
        return None
    knee = data.xanchor[joint]
    hulls = {geom: geom_points_to_world(model, data, geom, surface_points(model, geom)) for geom in candidates}
    down = _leg_direction(model, data, joint, hulls)
    if down is None:
        return None
    depths = {geom: float(((points - knee) @ down).max()) for geom, points in hulls.items()}
    lowest = max(depths.values())
    level = [geom for geom in candidates if depths[geom] >= lowest - _THRESHOLDS.level]
    short = [geom for geom in level if np.ptp(hulls[geom] @ down) < _THRESHOLDS.shin_length * lowest]
    geoms = tuple(sorted(short or level, key=lambda geom: -depths[geom]))
    ball = _ball_foot(model, data, geoms, knee, down)
    return ball if ball is not None else _hull_foot(model, data, geoms, knee, down, lowest, hulls)


def _ball_foot(model: Any, data: Any, geoms: tuple[int, ...], knee: Floats, down: Floats) -> Foot | None:
    """Make the foot from a single sphere or capsule geom; its ball is the sphere or the lower end of the capsule.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        geoms: Ids of the foot geoms.
        knee: Position of the knee, world frame, (3,), m.
        down: Direction from the knee to the middle of the foot, unit vector, world frame, (3,).

    Returns:
        The foot; None if there are several foot geoms, if the geom is no sphere or capsule, or if the capsule lies
        across the leg.
    """
    first = geoms[0]
    ends = end_spheres(model, first) if len(geoms) == 1 else []
    if not ends:
        return None
    heights = [float((knee - geom_points_to_world(model, data, first, centre)) @ down) for centre, _ in ends]
    if len(ends) > 1 and not np.ptp(heights) > ends[0][1]:
        return None
    centre, radius = ends[int(np.argmin(heights))]
    return Foot(geoms, int(model.geom_bodyid[first]), centre, radius, np.zeros((0, 3)), np.zeros(0))


def _hull_foot(
    model: Any,
    data: Any,
    geoms: tuple[int, ...],
    knee: Floats,
    down: Floats,
    length: float,
    hulls: dict[int, Floats],
) -> Foot:
    """Make a foot that one ball cannot represent, because it has several geoms or is no sphere or upright capsule.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        geoms: Ids of the foot geoms, the geom that reaches lowest first.
        knee: Position of the knee, world frame, (3,), m.
        down: Direction from the knee to the middle of the foot, unit vector, world frame, (3,).
        length: Distance along `down` from the knee to the lowest point of the leg's last link, m.
        hulls: Id of a geom -> k points on the surface of this geom, world frame, (k, 3), m.

    Returns:
        The foot: a ball for the kinematics, and the points and radii that describe the exact shape.
    """
    body = int(model.geom_bodyid[geoms[0]])
    points = np.concatenate([hulls[geom] for geom in geoms])
    thinnest = float(np.min([bounding_box(model, geom)[1].min() for geom in geoms]))
    radius = min(thinnest, _THRESHOLDS.max_radius * length)
    centre = _sole_middle(points, knee, down, _THRESHOLDS.sole_height * radius) - radius * down
    rotation = data.xmat[body].reshape(3, 3)
    foot = Foot(geoms, body, (centre - data.xpos[body]) @ rotation, radius, points, np.zeros(0))
    return _with_points(model, data, foot)


def extend_foot(
    model: Any, data: Any, joint: int, candidates: list[int], foot: Foot, tilts: tuple[float, float]
) -> Foot:
    """Add the geoms of the leg's last link that touch the ground when the robot stands with a tilted shin.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        joint: Id of the knee joint.
        candidates: Ids of the geoms of the leg's last link that collide with the ground.
        foot: The foot of the straight leg, made by `find_foot`.
        tilts: Smallest and largest tilt of the shin about the knee's axis in a stance, rad; 0 is straight down.

    Returns:
        The foot with the same ball, and with all geoms that touch the ground. If an added geom reaches below the ball,
        `points` and `radii` describe the shape of all foot geoms.
    """
    knee = data.xanchor[joint]
    axis = data.xaxis[joint]
    hulls = {geom: _rounded_hull_in_world(model, data, geom) for geom in candidates}
    centre = body_points_to_world(data, foot.body, foot.centre)
    down = centre - knee
    down -= (down @ axis) * axis
    down /= np.linalg.norm(down)
    directions = _gravity_directions(down, axis, tilts)
    depths = {geom: _depths_below(knee, hull, directions) for geom, hull in hulls.items()}
    lowest = np.max(list(depths.values()), axis=0)
    length = float(np.linalg.norm(centre - knee)) + foot.radius
    short = {geom for geom, (points, _) in hulls.items() if _is_short(points, down, length)}
    added = _touching_geoms(depths, lowest, short).difference(foot.geoms)
    if not added:
        return foot
    foot = foot._replace(geoms=(*foot.geoms, *sorted(added, key=lambda geom: -float(depths[geom].max()))))
    ball_depths = (centre - knee) @ directions.T + foot.radius
    if not foot.points.size and (lowest < ball_depths + _THRESHOLDS.ball_depth).all():
        return foot
    return _with_points(model, data, foot)


def _depths_below(knee: Floats, hull: tuple[Floats, float], directions: Floats) -> Floats:
    """Compute how far a geom reaches below the knee, for k directions of gravity.

    Args:
        knee: Position of the knee, world frame, (3,), m.
        hull: The geom as the convex hull of balls of equal size: the centre of each ball, world frame, (balls, 3), m,
            and the radius of the balls, m.
        directions: Directions of gravity, unit vectors, world frame, (k, 3).

    Returns:
        Depth of the geom's lowest point below the knee for each direction, (k,), m.
    """
    points, radius = hull
    depths: Floats = ((points - knee) @ directions.T).max(axis=0) + radius
    return depths


def _touching_geoms(depths: dict[int, Floats], lowest: Floats, short: set[int]) -> set[int]:
    """Find the geoms that touch the ground, or nearly touch it, in at least one of k poses of a standing robot.

    Args:
        depths: Id of a geom -> depth of its lowest point below the knee in each pose, (k,), m.
        lowest: Depth of the lowest point of all geoms below the knee in each pose, (k,), m.
        short: Ids of the geoms that are too short for a shin; a larger distance to the ground is accepted for them.

    Returns:
        Ids of the geoms that touch the ground.
    """
    touching = set()
    for geom, depth in depths.items():
        slack = _THRESHOLDS.short_level if geom in short else _THRESHOLDS.level
        if (depth >= lowest - slack).any():
            touching.add(geom)
    return touching


def _rounded_hull_in_world(model: Any, data: Any, geom: int) -> tuple[Floats, float]:
    """Represent a geom as the convex hull of balls of one radius in the world frame.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with kinematics.
        geom: Id of the geom.

    Returns:
        points: Centres of k balls, world frame, (k, 3), m.
        radius: Radius of the balls, m; 0 unless the geom is a sphere or a capsule.
    """
    points, radius = rounded_hull(model, geom)
    return geom_points_to_world(model, data, geom, points), radius


def _leg_direction(model: Any, data: Any, joint: int, hulls: dict[int, Floats]) -> Floats | None:
    """Return the direction from the knee to the middle of the leg's end, perpendicular to the knee's axis.

    This direction points straight down when the leg is straight.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        joint: Id of the knee joint.
        hulls: Id of a geom of the leg's last link -> k points on its surface, world frame, (k, 3), m.

    Returns:
        Unit vector, world frame, (3,); None if the geoms lie at the knee.
    """
    knee = data.xanchor[joint]
    axis = data.xaxis[joint]
    distances = {geom: float(np.linalg.norm(points - knee, axis=1).max()) for geom, points in hulls.items()}
    farthest = max(distances, key=lambda geom: distances[geom])
    length = distances[farthest]
    # The component along the knee's axis is removed, because a wide foot may have its centre outside the leg's plane.
    down = _normal_direction(_end_centre(model, data, farthest, knee) - knee, axis)
    if down is None:
        return None
    at_end = [geom for geom, distance in distances.items() if distance > _THRESHOLDS.end_distance * length]
    at_end = [geom for geom in at_end if np.ptp(hulls[geom] @ down) < _THRESHOLDS.shin_length * length]
    if len(at_end) == 0 or (len(at_end) == 1 and _is_ball(model, at_end[0], hulls[at_end[0]], down)):
        return down
    return _middle_direction(np.concatenate([hulls[geom] for geom in at_end]) - knee, down, axis)


def _middle_direction(points: Floats, down: Floats, axis: Floats) -> Floats:
    """Refine an estimate of the direction from the knee to the middle of the leg's end by fixed-point iteration.

    In each iteration, the new direction points to the middle of the leg's end. Along the present direction, the middle
    is as far from the knee as the farthest point. Across this direction, it is halfway between the foremost and the
    rearmost point.

    Args:
        points: Positions of k points of the geoms at the leg's end, relative to the knee, world frame, (k, 3), m.
        down: First estimate of the direction, unit vector, world frame, (3,).
        axis: Axis of the knee, unit vector, world frame, (3,).

    Returns:
        Unit vector perpendicular to the knee's axis, world frame, (3,).
    """
    for _ in range(_MIDDLE_ITERATIONS):
        ahead = np.cross(axis, down)
        along = points @ down
        across = points @ ahead
        middle = _normal_direction(along.max() * down + 0.5 * (across.min() + across.max()) * ahead, axis)
        assert middle is not None
        down = middle
    return down


def _is_ball(model: Any, geom: int, hull: Floats, down: Floats) -> bool:
    """Return True if the lower end of a geom is a ball, so that this ball can model the foot.

    Args:
        model: Compiled `mujoco.MjModel`.
        geom: Id of the geom.
        hull: Positions of k points on the surface of the geom, world frame, (k, 3), m.
        down: Direction of the leg, unit vector, world frame, (3,).

    Returns:
        True for a sphere, and for a capsule that does not lie across the leg.
    """
    ends = end_spheres(model, geom)
    return len(ends) == 1 or (len(ends) == 2 and float(np.ptp(hull @ down)) > 3.0 * ends[0][1])


def _normal_direction(vector: Floats, axis: Floats) -> Floats | None:
    """Return the direction of the component of a vector that is perpendicular to an axis.

    Args:
        vector: The vector, (3,), m.
        axis: Unit vector of the axis, in the same frame, (3,).

    Returns:
        Unit vector, (3,); None if the vector is parallel to the axis or nearly zero.
    """
    normal = vector - (vector @ axis) * axis
    length = float(np.linalg.norm(normal))
    if length < _THRESHOLDS.min_vector:
        return None
    direction: Floats = normal / length
    return direction


def _is_short(points: Floats, down: Floats, length: float) -> bool:
    """Return True if a geom is too short for a shin, so that it can be a foot.

    Args:
        points: Positions of k points on the surface of the geom, world frame, (k, 3), m.
        down: Direction of the leg, unit vector, world frame, (3,).
        length: Distance from the knee to the sole, m.

    Returns:
        True if the extent of the geom along `down` is less than half of `length`.
    """
    return float(np.ptp(points @ down)) < _THRESHOLDS.shin_length * length


def _gravity_directions(down: Floats, axis: Floats, tilts: tuple[float, float]) -> Floats:
    """Return the directions of gravity relative to the leg in k poses of a standing robot.

    The leg stays straight, and gravity is tilted instead of the shin. The lowest points of the foot are the same, and
    the joints of the model do not have to be moved.

    Args:
        down: Direction of the straight leg, unit vector, world frame, (3,).
        axis: Axis of the knee, unit vector, world frame, (3,).
        tilts: Smallest and largest tilt of the shin about the knee's axis, rad.

    Returns:
        Unit vectors on a grid of pitch and roll tilts, world frame, (k, 3).
    """
    pitches = np.linspace(*tilts, 27)
    rolls = np.linspace(-STANCE_TILTS.max_roll, STANCE_TILTS.max_roll, 9)
    pitch, roll = (each.reshape(-1, 1) for each in np.meshgrid(pitches, rolls))
    ahead = np.cross(axis, down)
    directions: Floats = np.cos(roll) * (np.cos(pitch) * down - np.sin(pitch) * ahead) + np.sin(roll) * axis
    return directions


def _with_points(model: Any, data: Any, foot: Foot) -> Foot:
    """Return the foot with `points` and `radii` that describe the exact shape of all its geoms.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with kinematics.
        foot: The foot; only its geoms, body and centre are used.

    Returns:
        A copy of the foot; the points are relative to its centre, in the frame of its body.
    """
    shapes = [(geom, *rounded_hull(model, geom)) for geom in foot.geoms]
    points = np.concatenate([geom_points_to_world(model, data, geom, points) for geom, points, _ in shapes])
    radii = np.concatenate([np.full(len(points), radius) for _, points, radius in shapes])
    rotation = data.xmat[foot.body].reshape(3, 3)
    return foot._replace(points=(points - body_points_to_world(data, foot.body, foot.centre)) @ rotation, radii=radii)


def extreme_points(points: Floats, radii: Floats) -> tuple[Floats, Floats]:
    """Reduce the points of a foot to those that can touch the ground.

    The function keeps the points that are extreme in one of the sampled directions. It adds the lowest points of the
    balls, so that the shape is exact when the leg points straight down.

    Args:
        points: Positions of k points of a foot, base frame with the leg straight down, (k, 3), m.
        radii: Radii of the balls about the k points, (k,), m; the foot is the convex hull of these balls.

    Returns:
        points: Extreme points, followed by the lowest points of balls with a radius above 0, (points, 3), m.
        radii: Radii of the balls about the extreme points, followed by zeros, (points,), m.
    """
    if not len(points):
        return points, radii
    extreme = np.unique((points @ _DIRECTIONS.T + radii[:, None]).argmax(axis=0))
    points = points[extreme]
    radii = radii[extreme]
    round_ends = radii > 0.0
    below = points[round_ends] - radii[round_ends, None] * (0.0, 0.0, 1.0)
    return np.concatenate((points, below)), np.concatenate((radii, np.zeros(len(below))))


def depths_below_centre(points: Floats, radii: Floats, angles: Floats, up: Floats) -> Floats:
    """Compute the depth of each foot's lowest point below the foot's centre.

    Each foot is the convex hull of balls about its k points.

    Args:
        points: Points of the feet relative to their centres, base frame with the legs straight down, (..., k, 3), m.
        radii: Radii of the balls about the k points, (..., k), m.
        angles: Joint angles of the legs (hip, thigh, calf), zero with the legs straight down, (..., 3), rad.
        up: Unit vector that points up in the world, base frame, (..., 3).

    Returns:
        Depths, (...,), m.
    """
    x, y, z = np.moveaxis(points, -1, 0)
    hip = angles[..., 0, None]
    shin = angles[..., 1, None] + angles[..., 2, None]
    ahead = np.cos(shin) * x + np.sin(shin) * z
    down = np.cos(shin) * z - np.sin(shin) * x
    left = np.cos(hip) * y - np.sin(hip) * down
    above = np.sin(hip) * y + np.cos(hip) * down
    heights = up[..., 0, None] * ahead + up[..., 1, None] * left + up[..., 2, None] * above
    lowest: Floats = (heights - radii).min(axis=-1)
    return -lowest


def _sole_middle(points: Floats, knee: Floats, down: Floats, slack: float) -> Floats:
    """Compute the middle of a foot's sole, which consists of the lowest points of the foot.

    Args:
        points: Positions of k points on the surface of the foot, world frame, (k, 3), m.
        knee: Position of the knee, world frame, (3,), m.
        down: Direction of the leg, unit vector, world frame, (3,).
        slack: Largest height above the lowest point of the foot at which a point belongs to the sole, m.

    Returns:
        Middle of the sole, world frame, (3,), m.
    """
    depths = (points - knee) @ down
    low = points[depths > depths.max() - slack]
    flat = low - np.outer((low - knee) @ down, down)
    middle: Floats = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    return middle + float(depths.max()) * down


def _end_centre(model: Any, data: Any, geom: int, knee: Floats) -> Floats:
    """Return the centre of the geom at the leg's end, world frame, (3,), m.

    For a sphere, this is its centre. For a capsule, it is the centre of the end sphere that is farther from the knee.
    For any other shape, it is the centre of the bounding box.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with kinematics.
        geom: Id of the geom.
        knee: Position of the knee, world frame, (3,), m.

    Returns:
        The centre, world frame, (3,), m.
    """
    centres = [centre for centre, _ in end_spheres(model, geom)] or [bounding_box(model, geom)[0]]
    positions = (geom_points_to_world(model, data, geom, centre) for centre in centres)
    return max(positions, key=lambda position: np.linalg.norm(position - knee))


def geom_points_to_world(model: Any, data: Any, geom: int, points: Floats) -> Floats:
    """Transform points from the frame of a geom's body to the world frame.

    Args:
        model: Compiled model.
        data: `mujoco.MjData` with kinematics.
        geom: Id of the geom.
        points: Points, body frame, (..., 3), m.

    Returns:
        The points, world frame, (..., 3), m.
    """
    return body_points_to_world(data, int(model.geom_bodyid[geom]), points)


def body_points_to_world(data: Any, body: int, points: Floats) -> Floats:
    """Transform points from the frame of a body to the world frame.

    Args:
        data: `mujoco.MjData` with kinematics.
        body: Id of the body.
        points: Points, body frame, (..., 3), m.

    Returns:
        The points, world frame, (..., 3), m.
    """
    return np.asarray(data.xpos[body] + points @ data.xmat[body].reshape(3, 3).T)
