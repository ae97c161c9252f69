"""Inertias that no link of its mass and size has: most often a placeholder, such as ixx = 1000 of 0.15 kg."""

from typing import Any, NamedTuple

import numpy as np

from quad_env.robots.arena import body_names
from quad_env.robots.collisions import HERE, OWN
from quad_env.robots.robot import Robot
from quad_env.robots.shapes import Floats, corners, descendants, geoms_of, rotation_of, welded

TOO_LARGE = 10.0
"""Least ratio of a moment of inertia to mass times the square of the link's reach that is named; a point mass at the
farthest point of the link has 1, the links of the robots of the `robots` extra at most 0.9."""
HEAVY_ARMATURE = 0.1
"""Least ratio of a joint's armature to the robot's mass times the square of its leg's length that is named; the robots
of the `robots` extra have at most 0.014."""
_SMALLEST = 0.1
"""Least reach of a link that is taken, as a share of the leg's length: links without any shape have none."""
_TINY = 5e-3
"""Moment of inertia, as a share of the robot's mass times the square of its leg's length, that changes no motion."""


class Inertia(NamedTuple):
    """The inertia of a link that is not believed."""

    body: int
    """Id in the robot's model."""
    name: str
    moment: float
    """Largest principal moment, kg·m²."""
    mass: float
    reach: float
    """From the centre of mass to the farthest point of the link, m."""

    @property
    def largest(self) -> float:
        """Largest moment of a link of that mass and reach, kg·m²."""
        return self.mass * self.reach**2


def unlikely_inertias(robot: Robot) -> list[Inertia]:
    """Return the links whose largest moment of inertia is far above what their mass and size allow."""
    model = robot.model
    root = model.body("base_link").id
    found = []
    for body in np.flatnonzero(descendants(model, root)):
        moment = float(model.body_inertia[body].max())
        mass = float(model.body_mass[body])
        reach = max(_reach(model, int(body)), _SMALLEST * robot.leg_length)
        inertia = Inertia(int(body), _name(model, int(body)), moment, mass, reach)
        if moment > max(TOO_LARGE * inertia.largest, _TINY * robot.mass * robot.leg_length**2):
            found.append(inertia)
    names = body_names(robot) if found else {}
    return [each._replace(name=names.get(model.body(each.body).name, each.name)) for each in found]


def unlikely_armatures(robot: Robot) -> list[int]:
    """Return the ids of the joints whose armature is as large as the inertia of whole legs."""
    model = robot.model
    limit = HEAVY_ARMATURE * robot.mass * robot.leg_length**2
    return [int(joint) for joint in model.dof_jntid[model.dof_armature > limit]]


def _reach(model: Any, body: int) -> float:
    """Distance from the centre of mass of a body to the farthest point of its rigid assembly, m.

    The assembly is the body and all bodies that are welded to it, with their shapes and the origins of the bodies below
    them: in many files a link carries the mass, and the links around it the shapes.
    """
    points: list[Floats] = []
    for each in welded(model, body):
        below = model.body_pos[np.flatnonzero(model.body_parentid == each)]
        own = [np.zeros((1, 3)), below, *(corners(model, geom) for geom in geoms_of(model, [each]))]
        points.append(_in_assembly(model, each, np.concatenate(own)))
    centre = _in_assembly(model, body, model.body_ipos[body])
    return float(np.linalg.norm(np.concatenate(points) - centre, axis=1).max())


def _in_assembly(model: Any, body: int, points: Floats) -> Floats:
    """Points of a body's frame, (..., 3), in the frame of the first body of its rigid assembly, m."""
    first = int(model.body_weldid[body])
    while body != first:
        points = model.body_pos[body] + points @ rotation_of(model.body_quat[body]).T
        body = int(model.body_parentid[body])
    return points


def _name(model: Any, body: int) -> str:
    """Name of a body as its file, or our naming of links, has it."""
    return str(model.body(body).name).removeprefix(OWN).removeprefix(HERE)
