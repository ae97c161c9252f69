"""Shapes of a compiled model's geoms: the boxes around them, points of their surfaces, and which meet the ground."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

GROUND_BIT = 1 << 30
"""Bit of `contype` of the geoms that collide with the ground, and of `conaffinity` of the ground. The geoms collide
with the ground whatever bits the model uses, and no two geoms of a robot collide that do not in its model.
"""

_SIGNS = np.stack(np.meshgrid(*3 * [(-1.0, 1.0)], indexing="ij"), axis=-1).reshape(-1, 3)
_TURNS = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
_CIRCLE = np.stack((np.cos(_TURNS), np.sin(_TURNS)), axis=1)
_HEIGHTS = np.sin(np.linspace(-0.5, 0.5, 25) * np.pi)
_SPHERE = np.concatenate([np.insert(np.sqrt(max(0.0, 1.0 - z * z)) * _CIRCLE, 2, z, axis=1) for z in _HEIGHTS])
"""Points of the unit sphere on circles of latitude, poles included, (k, 3)."""


def descendant_mask(model: Any, body: int) -> Bools:
    """Which bodies are this one or below it, (nbody,)."""
    found = np.zeros(model.nbody, bool)
    found[body] = True
    for each in range(body + 1, model.nbody):  # a parent comes before its children
        found[each] = found[model.body_parentid[each]]
    return found


def welded_bodies(model: Any, body: int) -> list[int]:
    """Ids of the body and of all those that no joint lets move against it, the body first."""
    same = np.flatnonzero(model.body_weldid == model.body_weldid[body])
    return [body, *(int(each) for each in same if each != body)]


def collision_mask(model: Any) -> Bools:
    """Which geoms collide by their bits, (ngeom,)."""
    return np.asarray((model.geom_contype | model.geom_conaffinity) != 0)


def ground_collision_mask(model: Any, root: int) -> Bools:
    """Which geoms of the robot, the bodies from `root` down, meet a ground, (ngeom,): those that collide by their bits,
    or in an explicit pair with a geom that is not the robot's."""
    own = descendant_mask(model, root)[model.geom_bodyid]
    found = own & collision_mask(model)
    for one, other in zip(model.pair_geom1, model.pair_geom2, strict=True):
        if own[one] != own[other]:
            found[one if own[one] else other] = True
    return np.asarray(found)


def geom_ids(model: Any, bodies: Iterable[int], among: Bools | None = None) -> list[int]:
    """Ids of the geoms of these bodies that are among those, (ngeom,); of all by default."""
    its = np.isin(model.geom_bodyid, list(bodies))
    return [int(geom) for geom in np.flatnonzero(its if among is None else its & among)]


def bounding_box(model: Any, geom: int) -> tuple[Floats, Floats, Floats]:
    """Centre, (3,), and half sizes, (3,), m, and rotation, (3, 3), of the box around a geom, in its body's frame."""
    rotation = rotation_matrix(model.geom_quat[geom])
    centre, half = model.geom_aabb[geom].reshape(2, 3)
    return model.geom_pos[geom] + rotation @ centre, half.copy(), rotation


def box_corners(model: Any, geom: int) -> Floats:
    """Corners of the box around a geom in its body's frame, (8, 3), m."""
    centre, half, rotation = bounding_box(model, geom)
    found: Floats = centre + (_SIGNS * half) @ rotation.T
    return found


def end_spheres(model: Any, geom: int) -> list[tuple[Floats, float]]:
    """Centre in the frame of its body, m, and radius of a sphere, or of both ends of a capsule; empty for the rest."""
    import mujoco

    kind, (radius, half), place = model.geom_type[geom], model.geom_size[geom, :2], model.geom_pos[geom].copy()
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return [(place, float(radius))]
    if kind != mujoco.mjtGeom.mjGEOM_CAPSULE:
        return []
    axis = rotation_matrix(model.geom_quat[geom])[:, 2]
    return [(place + sign * half * axis, float(radius)) for sign in (1.0, -1.0)]


def surface_points(model: Any, geom: int) -> Floats:
    """Points whose convex hull is a geom of any shape, curved ones to half a per cent, body frame, (k, 3), m."""
    import mujoco

    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    if (kind := model.geom_type[geom]) == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        points = model.mesh_vert[start : start + count].astype(np.float64)
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
    """Return points, (k, 3), body frame, m, and a radius, m: the geom is the hull of the points plus the radius."""
    if ends := end_spheres(model, geom):
        return np.stack([centre for centre, _ in ends]), ends[0][1]
    return surface_points(model, geom), 0.0


def rotation_matrix(quaternion: Any) -> Floats:
    """Rotation matrix of a quaternion (w, x, y, z), (3, 3)."""
    import mujoco

    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, quaternion)
    return flat.reshape(3, 3)
