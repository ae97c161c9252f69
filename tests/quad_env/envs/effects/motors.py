"""Readings of servos, motors, masses and loads, with the values that the randomisation draws."""

import math
from typing import Any

import mujoco
import numpy as np

from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.envs.effects.robot import DT, FAR, HOME, Effect, Robot, after, streams


def servo_targets(robot: Robot) -> np.ndarray:
    """Targets that the servos go by, from their torques, less the home pose."""
    now = robot.now
    return np.array((now.actuator_force + 10 * now.qvel[6:]) / 300 + now.qpos[7:] - HOME)


def servo_gains(robot: Robot) -> np.ndarray:
    """Stiffness and damping of each servo, by the torques of two targets and two speeds."""
    model, now = robot.model, robot.now
    torques = []
    for target, speed in ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1)):
        now.ctrl[:], now.qvel[6:] = now.qpos[7:] + target, speed
        mujoco.mj_forward(model, now)
        torques.append(now.actuator_force.copy())
    return 10.0 * np.stack((torques[1] - torques[0], torques[0] - torques[2]), axis=1)


def lagging(bandwidth: float) -> Effect:
    """A tenth of a radian is asked for."""
    share = 1 - math.exp(-DT * 2 * math.pi * bandwidth)
    return Effect(bandwidth, after(servo_targets, tuple(HOME + 0.1)), np.full(12, 0.1 * share))


def largest_torque(robot: Robot) -> float:
    return float(np.abs(robot.now.actuator_force).max())


def weight(robot: Robot) -> float:
    """What holds a robot at rest, kg."""
    return float(robot.now.qfrc_bias[2]) / 9.81


def grip(robot: Robot) -> float:
    """The friction of its feet on the ground."""
    now = robot.now  # first: then the model is its own
    (found,) = {float(contact.friction[0]) for contact in now.contact[: now.ncon]}
    return found


def centre_of_mass(robot: Robot) -> np.ndarray:
    """Of the trunk, along its axes."""
    now, trunk = robot.now, robot.model.body("base_link").id
    return (now.xipos[trunk] - now.xpos[trunk]) @ now.xmat[trunk].reshape(3, 3)


def far_torques(robot: Robot) -> np.ndarray:
    """Largest torques, where the targets are out of reach."""
    model, now = robot.model, robot.now
    now.ctrl[:] = FAR
    mujoco.mj_forward(model, now)
    return np.array(now.actuator_force)


NUMBERS = streams().randomisation
FRICTION, MASS, DELAY, *CENTRE = NUMBERS.uniform(-1, 1, 6)
STIFFNESS, DAMPING, STRENGTH, OFFSET = NUMBERS.uniform(-1, 1, (4, 12))
"""Of what is randomised."""


def load(robot: Robot) -> list[float]:
    """Mass of a payload, its place on the trunk, that of the cube that is drawn, and its moment of inertia."""
    now, trunk = robot.now, robot.model.body("base_link").id
    places = np.array((now.body("payload").xipos, now.geom("payload").xpos)) - now.xpos[trunk]
    mass = robot.model.body_subtreemass[trunk] - SIMPLE_QUAD.mass
    return [mass, *np.ravel(places @ now.xmat[trunk].reshape(3, 3)), robot.model.body("payload").inertia[0]]


def loaded(mass: float = 5.0, reach: tuple[float, float] = (0.2, 0.1), edge: float = 0.2) -> list[float]:
    place = *(streams().payload.uniform(-1, 1, 2) * reach), (SIMPLE_QUAD.trunk_size[2] + edge) / 2
    return [mass, *place, *place, mass * edge**2 / 6]


def temperature(robot: Robot) -> Any:
    return robot.base.simulation.winding_temperature[robot.row]
