"""SimpleQuad of another size: lengths, masses, moments and torques of its MJCF, scaled by dynamic similarity."""

from pathlib import Path

import mujoco
import numpy as np

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


def alike(folder: Path, longer: float = 0.4, heavier: float = 0.1) -> Robot:
    """Return the robot with scaled length and mass, as a user's robot."""
    spec = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    spec.modelname, time = "alike", np.sqrt(longer)
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for body in spec.bodies:
        body.pos, body.ipos, body.mass = longer * body.pos, longer * body.ipos, heavier * body.mass
        body.inertia = heavier * longer**2 * body.inertia
    for part in (*spec.geoms, *spec.sites):
        part.pos = longer * part.pos
        if part.name != "ground":
            part.size = longer * part.size
    for joint in spec.joints:
        joint.armature *= heavier * longer**2
        joint.damping = heavier * longer**2 / time * joint.damping
    for actuator in spec.actuators:
        actuator.forcerange = heavier * longer * actuator.forcerange
    spec.keys[0].qpos = [longer * value if place < 3 else value for place, value in enumerate(spec.keys[0].qpos)]
    path = folder / "alike.xml"
    path.write_text(spec.to_xml(), encoding="utf-8")
    return Robot.from_mjcf(path)
