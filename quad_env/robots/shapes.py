"""Geometry of the geoms in a compiled model: bounding boxes, surface points and end spheres.

Further functions select bodies or geoms, and return them as ids or as masks (boolean arrays).
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

GROUND_BIT = 1 << 30
"""Collision bit in `contype` of geoms that collide with the ground, and in `conaffinity` of the ground.

With this bit the geoms collide with the ground, independent of the collision bits in the user's model. The bit does not
change the self-collisions of the robot.
"""
_SIGNS = np.stack(np.meshgrid(*3 * [(-1.0, 1.0)], indexing="ij"), axis=-1).reshape(-1, 3)
"""Signs of the coordinates of a box's corners relative to its centre, (8, 3)."""
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
"""Angles of 96 points on a circle, with which polygons approximate round surfaces, (96,), rad."""
_CIRCLE = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), axis=1)
"""Coordinates x, y of 96 points on the unit circle, (96, 2)."""
_HEIGHTS = np.sin(np.linspace(-0.5, 0.5, 25) * np.pi)
"""Coordinates z of 25 circles of latitude on the unit sphere, from pole to pole, (25,)."""
_SPHERE = np.concatenate([np.insert(np.sqrt(max(0.0, 1.0 - z * z)) * _CIRCLE, 2, z, axis=1) for z in _HEIGHTS])
"""Coordinates x, y, z of k points on the unit sphere, which lie on circles of latitude, (k, 3)."""


def descendant_mask(model: Any, body: int) -> Bools:
    """Return a mask, (nbody,), that is True for a body and all bodies below it in the kinematic tree.

    Args:
        model: Compiled `mujoco.MjModel`.
        body: Id of the body.

    Returns:
        Boolean mask, (nbody,).
    """
    mask = np.zeros(model.nbody, bool)
    mask[body] = True
    for each in range(body + 1, model.nbody):  # The id of a parent is smaller than the ids of its children.
        mask[each] = mask[model.body_parentid[each]]
    return mask


def welded_bodies(model: Any, body: int) -> list[int]:
    """Return the ids of the body `body` and of all bodies that cannot move relative to it in `model`.

    Args:
        model: Compiled `mujoco.MjModel`.
        body: Id of the body.

    Returns:
        Ids of the bodies; `body` is the first.
    """
    same = np.flatnonzero(model.body_weldid == model.body_weldid[body])
    return [body, *(int(each) for each in same if each != body)]


def collision_mask(model: Any) -> Bools:
    """Return a mask, (ngeom,), that is True for geoms with a collision bit in `contype` or `conaffinity`."""
    return np.asarray((model.geom_contype | model.geom_conaffinity) != 0)


def ground_collision_mask(model: Any, root: int) -> Bools:
    """Find the geoms of a user's robot that collide with the ground.

    The found geoms are the geoms with a collision bit in `contype` or `conaffinity`, and the geoms in an explicit pair
    with a geom that does not belong to the robot.

    Args:
        model: Compiled `mujoco.MjModel` of the user's file.
        root: Id of the robot's root body, which has the free joint.

    Returns:
        Mask that is True for these geoms, (ngeom,).
    """
    is_robot_geom = descendant_mask(model, root)[model.geom_bodyid]
    mask = is_robot_geom & collision_mask(model)
    for one, other in zip(model.pair_geom1, model.pair_geom2, strict=True):
        if is_robot_geom[one] != is_robot_geom[other]:
            mask[one if is_robot_geom[one] else other] = True
    return np.asarray(mask)


def geom_ids(model: Any, bodies: Iterable[int], among: Bools | None = None) -> list[int]:
    """Return the ids of the geoms of some bodies.

    Args:
        model: Compiled `mujoco.MjModel`.
        bodies: Ids of the bodies.
        among: Mask of the geoms that may be returned, (ngeom,); None for all geoms.

    Returns:
        Ids of the geoms, in ascending order.
    """
    mask = np.isin(model.geom_bodyid, list(bodies))
    return [int(geom) for geom in np.flatnonzero(mask if among is None else mask & among)]


def bounding_box(model: Any, geom: int) -> tuple[Floats, Floats, Floats]:
    """Return the bounding box of a geom, aligned with the axes of the geom.

    Args:
        model: Compiled `mujoco.MjModel`.
        geom: Id of the geom.

    Returns:
        centre: Centre of the box, frame of the geom's body, (3,), m.
        half_sizes: Half lengths of the box along the axes of the geom, (3,), m.
        rotation: Rotation from the frame of the geom to the frame of its body, (3, 3).
    """
    rotation = rotation_matrix(model.geom_quat[geom])
    centre, half_sizes = model.geom_aabb[geom].reshape(2, 3)
    return model.geom_pos[geom] + rotation @ centre, half_sizes.copy(), rotation


def box_corners(model: Any, geom: int) -> Floats:
    """Return the corners of the bounding box of a geom, frame of the geom's body, (8, 3), m.

    Args:
        model: Compiled `mujoco.MjModel`.
        geom: Id of the geom.

    Returns:
        The corners, (8, 3), m.
    """
    centre, half_sizes, rotation = bounding_box(model, geom)
    corners: Floats = centre + (_SIGNS * half_sizes) @ rotation.T
    return corners


def end_spheres(model: Any, geom: int) -> list[tuple[Floats, float]]:
    """Return the sphere of a sphere geom, or the two end spheres of a capsule geom.

    Args:
        model: Compiled `mujoco.MjModel`.
        geom: Id of the geom.

    Returns:
        Centre, frame of the geom's body, (3,), m, and radius, m, of each sphere; an empty list for other shapes.
    """
    import mujoco

    kind = model.geom_type[geom]
    radius, half_length = model.geom_size[geom, :2]
    position = model.geom_pos[geom].copy()
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return [(position, float(radius))]
    if kind != mujoco.mjtGeom.mjGEOM_CAPSULE:
        return []
    axis = rotation_matrix(model.geom_quat[geom])[:, 2]
    return [(position + sign * half_length * axis, float(radius)) for sign in (1.0, -1.0)]


def surface_points(model: Any, geom: int) -> Floats:
    """Return points on the surface of a geom; the convex hull of the points is the collision shape.

    For a mesh, the points are its vertices. For a curved shape, the hull is accurate to half a per cent.

    Args:
        model: Compiled `mujoco.MjModel`.
        geom: Id of the geom.

    Returns:
        Positions of k points, frame of the geom's body, (k, 3), m.
    """
    import mujoco

    kinds = mujoco.mjtGeom
    size = model.geom_size[geom]
    if (kind := model.geom_type[geom]) == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        points = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(np.float64)
    elif kind == kinds.mjGEOM_CYLINDER:
        rims = [np.insert(size[0] * _CIRCLE, 2, sign * size[1], axis=1) for sign in (-1.0, 1.0)]
        points = np.concatenate(rims)
    elif kind == kinds.mjGEOM_ELLIPSOID:
        points = _SPHERE * size
    elif ends := end_spheres(model, geom):
        return np.concatenate([centre + radius * _SPHERE for centre, radius in ends])
    else:
        return box_corners(model, geom)
    return np.asarray(model.geom_pos[geom] + points @ rotation_matrix(model.geom_quat[geom]).T)


def rounded_hull(model: Any, geom: int) -> tuple[Floats, float]:
    """Represent a geom as the convex hull of balls of one radius; the radius is 0 for shapes with corners.

    Args:
        model: Compiled `mujoco.MjModel`.
        geom: Id of the geom.

    Returns:
        points: Centres of k balls, frame of the geom's body, (k, 3), m.
        radius: Radius of the balls, m; 0 unless the geom is a sphere or a capsule.
    """
    if ends := end_spheres(model, geom):
        return np.stack([centre for centre, _ in ends]), ends[0][1]
    return surface_points(model, geom), 0.0


def rotation_matrix(quaternion: Any) -> Floats:
    """Return the rotation matrix, (3, 3), of a unit quaternion (w, x, y, z), (4,)."""
    import mujoco

    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, quaternion)
    return flat.reshape(3, 3)
