"""Geometry of a compiled model's geoms: bounding boxes, surface points, spheres and masks."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

GROUND_BIT = 1 << 30
"""Bit in `contype` of the geoms that collide with the ground, and in `conaffinity` of the ground.

With this bit the geoms collide with the ground, independent of the bits in the user's model. The self-collisions of the
robot do not change.
"""
_SIGNS = np.stack(np.meshgrid(*3 * [(-1.0, 1.0)], indexing="ij"), axis=-1).reshape(-1, 3)
"""Signs of the coordinates of a box's corners relative to its centre, (8, 3)."""
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
_CIRCLE = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), axis=1)
"""Points of the unit circle, (96, 2)."""
_HEIGHTS = np.sin(np.linspace(-0.5, 0.5, 25) * np.pi)
_SPHERE = np.concatenate([np.insert(np.sqrt(max(0.0, 1.0 - z * z)) * _CIRCLE, 2, z, axis=1) for z in _HEIGHTS])
"""Points of the unit sphere on circles of latitude, including the poles, (k, 3)."""


def descendant_mask(model: Any, body: int) -> Bools:
    """Return the mask of the body with id `body` and all bodies below it in `model`, (nbody,)."""
    mask = np.zeros(model.nbody, bool)
    mask[body] = True
    for each in range(body + 1, model.nbody):  # The id of a parent is smaller than the ids of its children.
        mask[each] = mask[model.body_parentid[each]]
    return mask


def welded_bodies(model: Any, body: int) -> list[int]:
    """Return the ids of `body` and of all bodies welded to it in `model`; `body` is the first."""
    same = np.flatnonzero(model.body_weldid == model.body_weldid[body])
    return [body, *(int(each) for each in same if each != body)]


def collision_mask(model: Any) -> Bools:
    """Return the mask of the geoms with a bit in `contype` or `conaffinity`, (ngeom,)."""
    return np.asarray((model.geom_contype | model.geom_conaffinity) != 0)


def ground_collision_mask(model: Any, root: int) -> Bools:
    """Find the geoms of the robot that collide with the ground.

    These are the geoms with a bit in `contype` or `conaffinity`, and the geoms in an explicit pair with a geom that
    does not belong to the robot.

    Args:
        model: Compiled model.
        root: Id of the robot's root body.

    Returns:
        Mask of the geoms, (ngeom,).
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
        model: Compiled model.
        bodies: Ids of the bodies.
        among: Mask of the geoms to choose from, (ngeom,); None to choose from all geoms.

    Returns:
        Ids of the geoms, in ascending order.
    """
    mask = np.isin(model.geom_bodyid, list(bodies))
    return [int(geom) for geom in np.flatnonzero(mask if among is None else mask & among)]


def bounding_box(model: Any, geom: int) -> tuple[Floats, Floats, Floats]:
    """Return the bounding box of a geom, aligned with the axes of the geom.

    Args:
        model: Compiled model.
        geom: Id of the geom.

    Returns:
        centre: Centre of the box, body frame, (3,), m.
        half_sizes: Half lengths of the box along the axes of the geom, (3,), m.
        rotation: Rotation from the geom frame to the body frame, (3, 3).
    """
    rotation = rotation_matrix(model.geom_quat[geom])
    centre, half_sizes = model.geom_aabb[geom].reshape(2, 3)
    return model.geom_pos[geom] + rotation @ centre, half_sizes.copy(), rotation


def box_corners(model: Any, geom: int) -> Floats:
    """Return the corners of the bounding box of the geom with id `geom` in `model`, body frame, (8, 3), m."""
    centre, half_sizes, rotation = bounding_box(model, geom)
    corners: Floats = centre + (_SIGNS * half_sizes) @ rotation.T
    return corners


def end_spheres(model: Any, geom: int) -> list[tuple[Floats, float]]:
    """Return the sphere of a sphere geom, or the two end spheres of a capsule geom.

    Args:
        model: Compiled model.
        geom: Id of the geom.

    Returns:
        Centre, body frame, (3,), m, and radius, m, of each sphere; an empty list for other shapes.
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
    """Return points on the surface of a geom; their convex hull is the geom, or the convex hull of a mesh.

    The hull is accurate to half a per cent for a curved shape.

    Args:
        model: Compiled model.
        geom: Id of the geom.

    Returns:
        Points, body frame, (k, 3), m.
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
    """Represent a geom as the convex hull of balls of one radius.

    Args:
        model: Compiled model.
        geom: Id of the geom.

    Returns:
        points: Centres of the balls, body frame, (k, 3), m.
        radius: Radius of the balls, m; 0 unless the geom is a sphere or a capsule.
    """
    if ends := end_spheres(model, geom):
        return np.stack([centre for centre, _ in ends]), ends[0][1]
    return surface_points(model, geom), 0.0


def rotation_matrix(quaternion: Any) -> Floats:
    """Return the rotation matrix, (3, 3), of a quaternion (w, x, y, z)."""
    import mujoco

    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, quaternion)
    return flat.reshape(3, 3)
