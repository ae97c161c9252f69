"""Arrows that are drawn into a scene of MuJoCo, in the world frame."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from quad_env.columns import Vector

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0 … 1."""
_SHORTEST = 1e-3
"""m; shorter arrows are not drawn, for they have no direction."""


class Arrow(NamedTuple):
    """From a point to another, (3) m each; where they are the same nothing is drawn."""

    start: Vector[float]
    end: Vector[float]
    radius: float
    """Of the shaft, m."""
    colour: Colour


def draw_arrows(scene: mujoco.MjvScene, arrows: Sequence[Arrow]) -> None:
    """Add arrows to a scene; they cast no shadow."""
    for arrow in arrows:
        start, end = np.array(arrow.start), np.array(arrow.end)
        if np.linalg.norm(end - start) < _SHORTEST:
            continue
        geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_ARROW
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(arrow.colour, np.float32))
        mujoco.mjv_connector(geom, kind, arrow.radius, start, end)
        geom.size[2] *= 2.0  # of which MuJoCo draws half
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1
