"""Detection of inertias in a user's model that are implausible for the mass and size of a link.

Implausible inertias are most often placeholders, such as ixx = 1000 kg·m² for a link of 0.15 kg.
"""

from typing import Any, NamedTuple

import numpy as np

from quad_env.robots.model_remarks import body_names
from quad_env.robots.part_names import ATTACH_PREFIX, RENAMED_PREFIX
from quad_env.robots.robot import Robot
from quad_env.robots.shapes import Floats, box_corners, descendant_mask, geom_ids, rotation_matrix, welded_bodies

MAX_INERTIA_RATIO = 10.0
"""Largest plausible moment of inertia of a link, divided by its mass times the square of its reach.

The reach is the distance from the centre of mass to the farthest point of the link. A point mass at this point has the
ratio 1. The ratio is at most 0.9 for the links of the robots of the installation extra `robots`.
"""
MAX_ARMATURE_RATIO = 0.1
"""Largest plausible armature of a joint, divided by the robot's mass times the square of its leg length.

The quotient is at most 0.014 for the robots of the installation extra `robots`.
"""
_MIN_REACH = 0.1
"""Lower bound on the reach of a link in the inertia check, as a fraction of the leg length.

The reach is the distance from a link's centre of mass to its farthest point. The bound applies to links with smaller
shapes or no shapes.
"""
_NEGLIGIBLE = 5e-3
"""Moment of inertia up to which no warning is given, divided by the robot's mass times squared leg length.

Smaller moments do not affect the motion, even if they are implausible.
"""


class UnlikelyInertia(NamedTuple):
    """Link of a robot with an implausibly large moment of inertia; made by `find_unlikely_inertias`."""

    body: int
    """Id of the link's body in the robot's compiled model."""
    name: str
    """Name of the link in the user's file, or in the simulated scene if the link has no name in the file."""
    moment: float
    """Largest principal moment of inertia of the link, kg·m²."""
    mass: float
    """Mass of the link, kg."""
    reach: float
    """Distance from the link's centre of mass to the farthest point of the link, m."""

    @property
    def max_moment(self) -> float:
        """Largest plausible moment of inertia, kg·m²: the link's mass as a point mass at its farthest point."""
        return self.mass * self.reach**2


def find_unlikely_inertias(robot: Robot) -> list[UnlikelyInertia]:
    """Return the links with a moment of inertia that is too large for their mass and size."""
    model = robot.model
    root = model.body("base_link").id
    inertias = []
    for body in np.flatnonzero(descendant_mask(model, root)):
        moment = float(model.body_inertia[body].max())
        mass = float(model.body_mass[body])
        reach = max(_reach(model, int(body)), _MIN_REACH * robot.leg_length)
        inertia = UnlikelyInertia(int(body), _name(model, int(body)), moment, mass, reach)
        if moment > max(MAX_INERTIA_RATIO * inertia.max_moment, _NEGLIGIBLE * robot.mass * robot.leg_length**2):
            inertias.append(inertia)
    names = body_names(robot) if inertias else {}
    return [each._replace(name=names.get(model.body(each.body).name, each.name)) for each in inertias]


def find_unlikely_armatures(robot: Robot) -> list[int]:
    """Return the ids of the joints with an implausibly large armature, see MAX_ARMATURE_RATIO."""
    model = robot.model
    limit = MAX_ARMATURE_RATIO * robot.mass * robot.leg_length**2
    return [int(joint) for joint in model.dof_jntid[model.dof_armature > limit]]


def _reach(model: Any, body: int) -> float:
    """Return the distance from a body's centre of mass to the farthest point of its rigid assembly, m.

    The rigid assembly is the body and all bodies welded to it, with their shapes and the origins of their child bodies.
    The whole assembly is used because in many files one link has the mass, and links that are welded to it have the
    shapes.
    """
    points: list[Floats] = []
    for each in welded_bodies(model, body):
        below = model.body_pos[np.flatnonzero(model.body_parentid == each)]
        corners = [np.zeros((1, 3)), below, *(box_corners(model, geom) for geom in geom_ids(model, [each]))]
        points.append(_in_assembly(model, each, np.concatenate(corners)))
    centre = _in_assembly(model, body, model.body_ipos[body])
    return float(np.linalg.norm(np.concatenate(points) - centre, axis=1).max())


def _in_assembly(model: Any, body: int, points: Floats) -> Floats:
    """Transform points from the frame of a body to the frame of the topmost body of its rigid assembly.

    Args:
        model: Compiled `mujoco.MjModel`.
        body: Id of the body.
        points: Points, frame of the body, (..., 3), m.

    Returns:
        The points, frame of the topmost body of the same rigid assembly, (..., 3), m.
    """
    first = int(model.body_weldid[body])
    while body != first:
        points = model.body_pos[body] + points @ rotation_matrix(model.body_quat[body]).T
        body = int(model.body_parentid[body])
    return points


def _name(model: Any, body: int) -> str:
    """Return the name of the body with the id `body` in the compiled `model`, without prefixes of imported parts."""
    return str(model.body(body).name).removeprefix(ATTACH_PREFIX).removeprefix(RENAMED_PREFIX)
