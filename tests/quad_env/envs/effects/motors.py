"""Readings of servos, motors, masses and payloads, with the values that the randomisation draws."""

import math
from typing import Any

import mujoco
import numpy as np

from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.envs.effects.robot import DT, FAR, HOME, Effect, Robot, after, streams


def servo_targets(robot: Robot) -> np.ndarray:
    """Return the targets of the servos, computed from their torques, relative to the home pose."""
    now = robot.now
    return np.array((now.actuator_force + 10 * now.qvel[6:]) / 300 + now.qpos[7:] - HOME)


def servo_gains(robot: Robot) -> np.ndarray:
    """Return the stiffness and damping of each servo, from the torques at two targets and two speeds."""
    model, now = robot.model, robot.now
    torques = []
    for target, speed in ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1)):
        now.ctrl[:], now.qvel[6:] = now.qpos[7:] + target, speed
        mujoco.mj_forward(model, now)
        torques.append(now.actuator_force.copy())
    return 10.0 * np.stack((torques[1] - torques[0], torques[0] - torques[2]), axis=1)


def lagging(bandwidth: float) -> Effect:
    """Return the effect of a bandwidth on a target of 0.1 rad."""
    share = 1 - math.exp(-DT * 2 * math.pi * bandwidth)
    return Effect(bandwidth, after(servo_targets, tuple(HOME + 0.1)), np.full(12, 0.1 * share))


def largest_torque(robot: Robot) -> float:
    return float(np.abs(robot.now.actuator_force).max())


def weight(robot: Robot) -> float:
    """Return the weight of the robot, kg, from the bias force."""
    return float(robot.now.qfrc_bias[2]) / 9.81


def grip(robot: Robot) -> float:
    """Return the friction coefficient of the feet on the ground."""
    now = robot.now  # first, since it sets the robot's own model
    (found,) = {float(contact.friction[0]) for contact in now.contact[: now.ncon]}
    return found


def centre_of_mass(robot: Robot) -> np.ndarray:
    """Return the centre of mass of the trunk, trunk axes."""
    now, trunk = robot.now, robot.model.body("base_link").id
    return (now.xipos[trunk] - now.xpos[trunk]) @ now.xmat[trunk].reshape(3, 3)


def far_torques(robot: Robot) -> np.ndarray:
    """Return the torques at unreachable targets, N·m."""
    model, now = robot.model, robot.now
    now.ctrl[:] = FAR
    mujoco.mj_forward(model, now)
    return np.array(now.actuator_force)


NUMBERS = streams().randomisation
FRICTION, MASS, DELAY, *CENTRE = NUMBERS.uniform(-1, 1, 6)
STIFFNESS, DAMPING, STRENGTH, OFFSET = NUMBERS.uniform(-1, 1, (4, 12))
"""Drawn values of the randomisation."""


def load(robot: Robot) -> list[float]:
    """Return mass, position in the trunk and drawn position of a payload, and its moment of inertia."""
    now, trunk = robot.now, robot.model.body("base_link").id
    drawn = robot.base.simulation.drawn_snapshot(robot.row)
    places = np.array((now.body("payload").xipos, drawn.geom("payload").xpos)) - now.xpos[trunk]
    mass = robot.model.body_subtreemass[trunk] - SIMPLE_QUAD.mass
    return [mass, *np.ravel(places @ now.xmat[trunk].reshape(3, 3)), robot.model.body("payload").inertia[0]]


def loaded(mass: float = 5.0, reach: tuple[float, float] = (0.2, 0.1), edge: float = 0.2) -> list[float]:
    place = *(streams().payload.uniform(-1, 1, 2) * reach), (SIMPLE_QUAD.trunk_size[2] + edge) / 2
    return [mass, *place, *place, mass * edge**2 / 6]


def temperature(robot: Robot) -> Any:
    return robot.base.simulation.winding_temperature[robot.row]
