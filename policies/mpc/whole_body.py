"""Joint torques that make of planned forces and motions what the whole body can do.

A program over the generalised acceleration and the forces of the stance feet: the trunk is to turn and the centre of
mass to move as planned, stance feet are to rest, swinging ones to follow their paths; the floating base has no motor,
forces lie within friction, torques within the motors' limits.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats
from policies.mpc.parameters import MpcParameters
from policies.mpc.quadratic_program import QpBatch, Solver, solve
from policies.mpc.rigid_body import Friction, friction_constraints, group_by_stance_count
from quad_env.columns import EnvIndices, Mask
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import DynamicsTerms

TRUNK = slice(3, 6)
"""Angular part of the generalised velocity."""
JOINT_ACCELERATION_WEIGHT, BASE_ACCELERATION_WEIGHT = 1e-5, 1e-6
"""Weights of squared joint accelerations and of the trunk's, which make the program definite."""


class WholeBodyReference(NamedTuple):
    """What the bodies of n robots are to do now."""

    base_angular_acceleration: Floats
    """Angular accelerations of the trunks, base frame, (n, 3), rad/s²."""
    foot_acceleration: Floats
    """Accelerations of the feet, world frame, (n, 4, 3), m/s²."""
    contact_force: Floats
    """Of the stance feet, world frame, (n, 4, 3), N."""
    stance: Mask
    """(n, 4)."""


class Torques(NamedTuple):
    """What the joints of n robots are to do."""

    torque: Floats
    """(n, 12), N·m."""
    acceleration: Floats
    """Of the joints, (n, 12), rad/s²."""
    has_solution: Mask
    """For which robots there is an answer; the others' is zero, (n,)."""


def solve_whole_body(
    bodies: DynamicsTerms,
    reference: WholeBodyReference,
    wrench: Floats,
    friction: Friction,
    limits: tuple[Floats, Floats],
    p: MpcParameters,
    solver: Solver = solve,
) -> Torques:
    """The programs of the bodies, solved; see `programs`."""
    count, size = bodies.bias_force.shape
    torque, acceleration, has_solution = (
        np.zeros((count, size - 6)),
        np.zeros((count, size - 6)),
        np.zeros(count, np.bool_),
    )
    for robots, each in make_programs(bodies, reference, wrench, friction, limits, p):
        solutions = solver(each)
        needed = np.matmul(each.constraint_matrix[:, 6:size], solutions.x[..., None])[..., 0]
        torque[robots] = np.where(solutions.solved[:, None], needed + bodies.bias_force[robots, 6:], 0.0)
        acceleration[robots] = np.where(solutions.solved[:, None], solutions.x[:, 6:size], 0.0)
        has_solution[robots] = solutions.solved
    return Torques(torque, acceleration, has_solution)


def make_programs(
    bodies: DynamicsTerms,
    reference: WholeBodyReference,
    wrench: Floats,
    friction: Friction,
    limits: tuple[Floats, Floats],
    p: MpcParameters,
) -> Iterator[tuple[EnvIndices, QpBatch]]:
    """Programs over generalised acceleration and forces of the stance feet, those of one shape together, with the
    robots whose they are. `wrench` pushes their trunks, (n, 6), N and N·m; `limits`: least and largest torques, N·m."""
    size = bodies.bias_force.shape[1]
    bias = bodies.bias_force.copy()
    bias[:, :6] -= wrench
    feet = bodies.jacobians.reshape(len(bias), -1, size)
    weight = np.where(reference.stance, p.standing_priority, p.swinging_priority).repeat(3, axis=1)[..., None]
    aims = (reference.foot_acceleration - bodies.foot_bias_acceleration).reshape(weight.shape)
    following = np.matmul(feet.transpose(0, 2, 1), np.concatenate((weight * feet, weight * aims), axis=2))
    least, most = -bias, -bias.copy()  # the floating base has no motor
    least[:, 6:] += limits[0]
    most[:, 6:] += limits[1]
    for robots in group_by_stance_count(reference.stance.sum(axis=1)):
        group, these = len(robots), slice(None) if len(robots) == len(bias) else robots
        stance = reference.stance[these]
        contact = bodies.jacobians[these][stance].reshape(group, -1, size)
        forces = slice(size, size + contact.shape[1])
        hessian = np.zeros((group, forces.stop, forces.stop))
        hessian[:, :size, :size] = following[these, :, :size]
        diagonal = np.full(forces.stop, JOINT_ACCELERATION_WEIGHT)
        diagonal[:6], diagonal[forces] = BASE_ACCELERATION_WEIGHT, p.force_priority
        diagonal[TRUNK] += p.turning_priority
        hessian.reshape(group, -1)[:, :: forces.stop + 1] += diagonal
        gradient = np.zeros((group, forces.stop))
        gradient[:, TRUNK] = -p.turning_priority * reference.base_angular_acceleration[these]
        gradient[:, :size] -= following[these, :, size]
        gradient[:, forces] = -p.force_priority * reference.contact_force[these][stance].reshape(group, -1)
        pyramid, lower, upper = friction_constraints(contact.shape[1] // 3, friction.select(these))
        rows = np.zeros((group, size + pyramid.shape[1], forces.stop))
        rows[:, :size, :size] = bodies.inertia[these]
        rows[:, :size, forces] = -contact.transpose(0, 2, 1)  # less bias: what the motors have to give
        rows[:, size:, forces] = pyramid
        lower = np.concatenate((least[these], lower), axis=1)
        upper = np.concatenate((most[these], upper), axis=1)
        yield robots, QpBatch(hessian, gradient, rows, lower, upper, equalities=6)


_DAMPING = 1e-4
"""Added to the squared Jacobian of a leg, m²: a straight one does not accelerate along itself."""


def leg_torques(
    bodies: DynamicsTerms, reference: WholeBodyReference, wrench: Floats, limits: tuple[Floats, Floats]
) -> Torques:
    """Torques without a program: each leg bears its planned force and follows its path; the trunk moves as planned.

    τ = M q̈ + h - Jᵀf, with q̈ of the trunk from the planned forces and of each leg such that its foot has the wished
    acceleration. What one leg's motion does to the others is left out; friction is the plan's; torques are clipped to
    `limits`, N·m. `wrench`: on the trunks, (n, 6), N and N·m.
    """
    forces = np.where(reference.stance[..., None], reference.contact_force, 0.0)
    linear = (forces.sum(axis=1) + wrench[:, :3]) / bodies.mass[:, None] - (0.0, 0.0, GRAVITY)
    trunk = np.concatenate((linear, reference.base_angular_acceleration), axis=1)
    carried = np.einsum("nlxk,nk->nlx", bodies.jacobians[..., :6], trunk)
    legs = bodies.leg_jacobians
    across = legs.swapaxes(2, 3)
    squares = np.matmul(across, legs) + _DAMPING * np.eye(3)
    asked = np.matmul(across, (reference.foot_acceleration - bodies.foot_bias_acceleration - carried)[..., None])
    joints = np.linalg.solve(squares, asked)[..., 0].reshape(len(trunk), 12)
    motion = np.concatenate((trunk, joints), axis=1)
    needed = np.einsum("nij,nj->ni", bodies.inertia[:, 6:], motion) + bodies.bias_force[:, 6:]
    stance_forces = np.matmul(across, forces[..., None])[..., 0].reshape(joints.shape)
    torque = np.clip(needed - stance_forces, *limits)
    return Torques(torque, joints, np.isfinite(torque).all(axis=1))
