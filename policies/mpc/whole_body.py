"""Joint torques that make of planned forces and motions what the whole body can do.

A program over the generalised acceleration and the forces of the standing feet: the trunk is to turn and the centre of
mass to move as planned, standing feet are to rest, swinging ones to follow their paths; the floating base has no motor,
forces lie within friction, torques within the motors' limits.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.mpc.quadratic_program import Program, Solution, solve
from policies.mpc.rigid_body import Friction, friction_rows
from quad_env.physics.dynamics import RigidBodies

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

TRUNK = slice(3, 6)
"""Angular part of the generalised velocity."""


class Wish(NamedTuple):
    """What one robot's body is to do now."""

    turning: Floats
    """Angular acceleration of the trunk, base frame, (3,), rad/s²."""
    feet: Floats
    """Accelerations of the feet, world frame, (4, 3), m/s²."""
    forces: Floats
    """Of the standing feet, world frame, (4, 3), N."""
    standing: Bools
    """(4,)."""


class Priorities(NamedTuple):
    """Weights of the squares of what is missed."""

    turning: float
    """Of the trunk's angular acceleration."""
    standing: float
    """Of the accelerations of feet that stand."""
    swinging: float
    """The same of feet that swing."""
    force: float
    """Of the feet's forces."""
    joints: float = 1e-5
    """Of joint accelerations, which makes the program definite."""
    base: float = 1e-6
    """Of the trunk's, for the same."""


class Torques(NamedTuple):
    """What one robot's joints are to do."""

    torque: Floats
    """(12,), N·m."""
    acceleration: Floats
    """Of the joints, (12,), rad/s²."""
    solution: Solution


def torques(
    bodies: RigidBodies,
    robot: int,
    wish: Wish,
    wrench: Floats,
    friction: Friction,
    limit: float,
    priorities: Priorities,
) -> Torques:
    """The program of that robot of the bodies, solved; `wrench` pushes its trunk, (6,), N and N·m."""
    inertia, bias = bodies.inertia[robot], bodies.bias[robot].copy()
    bias[:6] -= wrench
    jacobians, drift, standing = bodies.jacobians[robot], bodies.drift[robot], wish.standing
    contact = jacobians[standing].reshape(-1, len(bias))
    moves, forces = slice(len(bias)), slice(len(bias), len(bias) + len(contact))
    diagonal, gradient = np.zeros(forces.stop), np.zeros(forces.stop)
    diagonal[moves], diagonal[:6], diagonal[forces] = priorities.joints, priorities.base, priorities.force
    diagonal[TRUNK] += priorities.turning
    gradient[TRUNK] = -priorities.turning * wish.turning
    gradient[forces] = -priorities.force * wish.forces[standing].reshape(-1)
    hessian = np.diag(diagonal)
    for chosen, weight in ((standing, priorities.standing), (~standing, priorities.swinging)):
        task, aim = jacobians[chosen].reshape(-1, len(bias)), (wish.feet[chosen] - drift[chosen]).reshape(-1)
        hessian[moves, moves] += weight * task.T @ task
        gradient[moves] -= weight * task.T @ aim
    needed = np.concatenate((inertia, -contact.T), axis=1)  # less bias: what the motors have to give
    pyramid, lower, upper = friction_rows(len(contact) // 3, friction)
    friction_only = np.concatenate((np.zeros((len(pyramid), len(bias))), pyramid), axis=1)
    most = np.concatenate((np.zeros(6), np.full(len(bias) - 6, limit)))  # the floating base has no motor
    program = Program(
        hessian,
        gradient,
        np.concatenate((needed, friction_only)),
        np.concatenate((-most - bias, lower)),
        np.concatenate((most - bias, upper)),
        equalities=6,
    )
    found = solve(program)
    return Torques(needed[6:] @ found.value + bias[6:], found.value[6 : len(bias)], found)
