"""Arrows and balls in the world frame, drawn into a MuJoCo scene."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from quad_env.columns import Components

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, each from 0 to 1."""
_MIN_LENGTH = 1e-3
"""Minimum length of a drawn arrow, m; the direction of a shorter arrow is not defined."""


class Arrow(NamedTuple):
    """Arrow between two points; nothing is drawn if the points coincide."""

    start: Components[float]
    """Start, world frame, (3), m."""
    end: Components[float]
    """Tip, world frame, (3), m."""
    radius: float
    """Radius of the shaft, m."""
    colour: Colour


class Ball(NamedTuple):
    """Glowing ball with a label."""

    centre: Components[float]
    """Centre, world frame, (3), m."""
    radius: float
    """Radius, m."""
    colour: Colour
    name: str
    """Text of the label."""


def draw_marks(scene: mujoco.MjvScene, marks: Sequence[Arrow | Ball]) -> None:
    """Add arrows and balls, which cast no shadow, to a scene.

    Args:
        scene: Scene to draw into.
        marks: Arrows and balls to add.
    """
    for mark in marks:
        geom = scene.geoms[scene.ngeom]
        if isinstance(mark, Ball):
            _draw_ball(geom, mark)
        elif not _draw_arrow(geom, mark):
            continue
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1


def _draw_ball(geom: mujoco.MjvGeom, ball: Ball) -> None:
    """Turn a geom of a scene into a ball."""
    size = np.full(3, ball.radius)
    colour = np.array(ball.colour, np.float32)
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, np.array(ball.centre), np.eye(3).ravel(), colour)
    geom.label = ball.name
    geom.emission = 0.6


def _draw_arrow(geom: mujoco.MjvGeom, arrow: Arrow) -> bool:
    """Turn a geom of a scene into an arrow; return False if the arrow is too short to draw."""
    start, end = np.array(arrow.start), np.array(arrow.end)
    if np.linalg.norm(end - start) < _MIN_LENGTH:
        return False
    kind = mujoco.mjtGeom.mjGEOM_ARROW
    colour = np.array(arrow.colour, np.float32)
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
    mujoco.mjv_connector(geom, kind, arrow.radius, start, end)
    geom.size[2] *= 2.0  # because MuJoCo draws half of this length
    return True
