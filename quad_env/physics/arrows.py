"""Arrows and balls that are drawn into a scene of MuJoCo, in the world frame."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from quad_env.columns import Components

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0 … 1."""
_SHORTEST = 1e-3
"""m; shorter arrows are not drawn, for they have no direction."""


class Arrow(NamedTuple):
    """From a point to another, (3) m each; where they are the same nothing is drawn."""

    start: Components[float]
    end: Components[float]
    radius: float
    """Of the shaft, m."""
    colour: Colour


class Ball(NamedTuple):
    """A ball that shines, with a name next to it."""

    centre: Components[float]
    radius: float
    colour: Colour
    name: str


def draw_marks(scene: mujoco.MjvScene, marks: Sequence[Arrow | Ball]) -> None:
    """Add arrows and balls to a scene; they cast no shadow."""
    for mark in marks:
        geom, colour = scene.geoms[scene.ngeom], np.array(mark.colour, np.float32)
        if isinstance(mark, Ball):
            size, kind = np.full(3, mark.radius), mujoco.mjtGeom.mjGEOM_SPHERE
            mujoco.mjv_initGeom(geom, kind, size, np.array(mark.centre), np.eye(3).ravel(), colour)
            geom.label, geom.emission = mark.name, 0.6
        else:
            start, end, kind = np.array(mark.start), np.array(mark.end), mujoco.mjtGeom.mjGEOM_ARROW
            if np.linalg.norm(end - start) < _SHORTEST:
                continue
            mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
            mujoco.mjv_connector(geom, kind, mark.radius, start, end)
            geom.size[2] *= 2.0  # of which MuJoCo draws half
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1
