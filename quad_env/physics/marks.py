"""Marks that are drawn into a scene of MuJoCo, in the world frame."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from quad_env.columns import Array, Vector

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0 … 1."""
_SHORTEST = 1e-3
"""m; shorter arrows are not drawn, for they have no direction."""
_SHADOWLESS = mujoco.mjtCatBit.mjCAT_DECOR
"""Category of what casts no shadow."""


class Arrow(NamedTuple):
    """From a point to another, (3) m each; where they are the same nothing is drawn."""

    start: Vector[float]
    end: Vector[float]
    radius: float
    """Of the shaft, m."""
    colour: Colour


class Ghost(NamedTuple):
    """The robot once more, in its home pose and one colour."""

    position: Vector[float]
    """Trunk centre, (3), m."""
    rotation: Array
    """From the base frame to the world frame, (3, 3)."""
    colour: Colour


Mark = Arrow | Ghost


class Marker:
    """Adds marks to scenes of a model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._ghost: mujoco.MjData | None = None

    def draw(self, scene: mujoco.MjvScene, marks: Sequence[Mark]) -> None:
        """Add them."""
        for mark in marks:
            if isinstance(mark, Arrow):
                _add_arrow(scene, mark)
            else:
                self._add_ghost(scene, mark)

    def _add_ghost(self, scene: mujoco.MjvScene, ghost: Ghost) -> None:
        before = scene.ngeom
        if self._ghost is None:
            self._ghost = mujoco.MjData(self._model)
            mujoco.mj_resetDataKeyframe(self._model, self._ghost, self._model.key("home").id)
        self._ghost.qpos[:3] = ghost.position
        mujoco.mju_mat2Quat(self._ghost.qpos[3:7], ghost.rotation.ravel())
        mujoco.mj_kinematics(self._model, self._ghost)
        what = mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.mjtCatBit.mjCAT_DYNAMIC
        mujoco.mjv_addGeoms(self._model, self._ghost, *what, scene)
        for geom in scene.geoms[before : scene.ngeom]:
            _paint(geom, ghost.colour)


def _add_arrow(scene: mujoco.MjvScene, arrow: Arrow) -> None:
    start, end = np.array(arrow.start), np.array(arrow.end)
    if np.linalg.norm(end - start) < _SHORTEST:
        return
    geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_ARROW
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(arrow.colour, np.float32))
    mujoco.mjv_connector(geom, kind, arrow.radius, start, end)
    geom.size[2] *= 2.0  # of which MuJoCo draws half
    geom.category = _SHADOWLESS
    scene.ngeom += 1


def _paint(geom: mujoco.MjvGeom, colour: Colour) -> None:
    """In one colour, without the material's texture and gloss, and without a shadow."""
    geom.matid, geom.rgba[:], geom.category = -1, colour, _SHADOWLESS
    geom.specular = geom.shininess = geom.reflectance = 0.0
