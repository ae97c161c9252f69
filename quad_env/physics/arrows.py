"""Arrows and balls, which mark quantities such as forces in rendered images of a robot."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from quad_env.columns import Components

Colour = tuple[float, float, float, float]
"""Colour of a mark: red, green, blue and opacity, each from 0 to 1."""
_MIN_LENGTH = 1e-3
"""Minimum length of a drawn arrow, m; the direction of a shorter arrow is not defined."""


class Arrow(NamedTuple):
    """Arrow between two points in a rendered scene; nothing is drawn if the points coincide."""

    start: Components[float]
    """Position of the arrow's start, world frame, (3), m."""
    end: Components[float]
    """Position of the arrow's tip, world frame, (3), m."""
    radius: float
    """Radius of the arrow's shaft, m."""
    colour: Colour


class Ball(NamedTuple):
    """Glowing ball with a text label in a rendered scene."""

    centre: Components[float]
    """Position of the ball's centre, world frame, (3), m."""
    radius: float
    """Radius of the ball, m."""
    colour: Colour
    name: str
    """Text of the label next to the ball."""


def draw_marks(scene: mujoco.MjvScene, marks: Sequence[Arrow | Ball]) -> None:
    """Add arrows and balls, which cast no shadow, to a MuJoCo scene.

    Args:
        scene: MuJoCo scene to draw into.
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
    """Set shape, position, colour and label of a scene's `geom` to the `ball`."""
    size = np.full(3, ball.radius)
    colour = np.array(ball.colour, np.float32)
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, np.array(ball.centre), np.eye(3).ravel(), colour)
    geom.label = ball.name
    geom.emission = 0.6


def _draw_arrow(geom: mujoco.MjvGeom, arrow: Arrow) -> bool:
    """Set shape, position and colour of a scene's `geom` to the `arrow`; return False if it is too short to draw."""
    start, end = np.array(arrow.start), np.array(arrow.end)
    if np.linalg.norm(end - start) < _MIN_LENGTH:
        return False
    kind = mujoco.mjtGeom.mjGEOM_ARROW
    colour = np.array(arrow.colour, np.float32)
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
    mujoco.mjv_connector(geom, kind, arrow.radius, start, end)
    # The length is doubled, because MuJoCo draws half of it.
    geom.size[2] *= 2.0
    return True
