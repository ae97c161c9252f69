"""Whole-body controller: a quadratic program (QP) for the joint torques that track planned forces and motions.

The variables of the QP are the generalised acceleration and the contact forces of the stance feet. The cost penalises
errors of the trunk's angular acceleration, errors of the foot accelerations, and deviations from the planned contact
forces. The constraints are the equations of motion of the floating base (which has no motor), the friction pyramids,
and the torque limits of the joints.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats
from policies.mpc.parameters import MpcParameters
from policies.mpc.quadratic_program import QpBatch, Solver, solve
from policies.mpc.rigid_body import Friction, friction_constraints, group_by_stance_count
from quad_env.columns import EnvIndices, EnvSelection, Mask
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import DynamicsTerms

TRUNK_ROTATION = slice(3, 6)
"""Slice of the trunk's angular part in a generalised velocity, rad/s, or generalised acceleration, rad/s²."""
JOINT_ACCELERATION_WEIGHT = 1e-5
"""Weight of the squared joint accelerations in the whole-body QP, s⁴/rad².

It is small, and keeps the Hessian of the QP positive definite."""
BASE_ACCELERATION_WEIGHT = 1e-6
"""Weight of the squared linear, s⁴/m², and angular, s⁴/rad², trunk acceleration in the whole-body QP.

It is small, and keeps the Hessian of the QP positive definite."""
_DAMPING = 1e-4
"""Damping added to Jᵀ J of the foot Jacobian J of a leg when foot accelerations are converted to the joints, m²/rad².

It keeps the joint accelerations finite, because a straight leg cannot accelerate its foot along itself."""


class WholeBodyReference(NamedTuple):
    """Reference accelerations and planned contact forces of n robots, which the whole-body controller tracks."""

    base_angular_acceleration: Floats
    """Angular acceleration of the trunk that the whole-body controller tracks, base frame, (n, 3), rad/s²."""
    foot_acceleration: Floats
    """Accelerations of the feet that the whole-body controller tracks, level frame (yaw only), (n, 4, 3), m/s²."""
    contact_force: Floats
    """Planned ground reaction forces on the feet, level frame, (n, 4, 3), N; only stance feet are used.

    The level frame turns only with the yaw of the robot, and its z axis points up.
    """
    stance: Mask
    """True for feet in stance, which carry the robot in the next control period, (n, 4)."""


class Torques(NamedTuple):
    """Planned joint torques of n robots, and the joint accelerations that these torques cause."""

    torque: Floats
    """Planned joint torques of n robots, (n, 12), N·m."""
    acceleration: Floats
    """Joint accelerations that the planned joint torques cause, (n, 12), rad/s²."""
    has_solution: Mask
    """True for robots with valid joint torques, (n,).

    It is False for a robot if its whole-body QP has no solution or its torques are not finite."""


def solve_whole_body(
    bodies: DynamicsTerms,
    reference: WholeBodyReference,
    wrench: Floats,
    friction: Friction,
    limits: tuple[Floats, Floats],
    p: MpcParameters,
    solver: Solver = solve,
) -> Torques:
    """Compute the joint torques of n robots by solving the whole-body QPs from `make_programs`.

    Args:
        bodies: Inertia matrix, bias force, Jacobians and other dynamics terms of n robots.
        reference: Accelerations and contact forces to track.
        wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
            centre, base frame, N·m.
        friction: Bounds of the contact forces.
        limits: Minimum and maximum joint torques, (n, 12) each, N·m.
        p: Parameters with the weights of the cost.
        solver: Function that solves a batch of QPs.

    Returns:
        Joint torques and joint accelerations; both are zero for a robot with a QP that has no solution.
    """
    count, size = bodies.bias_force.shape
    torque = np.zeros((count, size - 6))
    acceleration = np.zeros((count, size - 6))
    has_solution = np.zeros(count, np.bool_)
    for robots, programs in make_programs(bodies, reference, wrench, friction, limits, p):
        solutions = solver(programs)
        solved = solutions.solved[:, None]
        without_bias = np.matmul(programs.constraint_matrix[:, 6:size], solutions.x[..., None])[..., 0]
        torque[robots] = np.where(solved, without_bias + bodies.bias_force[robots, 6:], 0.0)
        acceleration[robots] = np.where(solved, solutions.x[:, 6:size], 0.0)
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
    """Yield the whole-body QPs of n robots, in batches of robots with equal numbers of stance feet.

    The variables of a QP are the generalised acceleration q̈ and the contact forces f of the stance feet.

    The cost is a weighted sum of the squared errors of three quantities. They are the foot accelerations J q̈ + J̇ q̇,
    the trunk's angular acceleration, and the contact forces f.

    The equations of motion are M q̈ + h - w - Jᵀ f = (0, τ). M is the inertia matrix, h the bias force, w the external
    wrench, J the Jacobian of the feet and τ the joint torques. The constraints are the six equations of the trunk, the
    limits of τ, and the friction pyramid of each stance foot.

    Args:
        bodies: Inertia matrix, bias force, Jacobians and other dynamics terms of n robots.
        reference: Accelerations and contact forces to track.
        wrench: External wrench w on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
            centre, base frame, N·m.
        friction: Bounds of the contact forces.
        limits: Minimum and maximum joint torques, (n, 12) each, N·m.
        p: Parameters with the weights of the cost.

    Yields:
        Indices of the g robots of a batch, (g,), and the QPs of these robots.
    """
    foot_cost = _foot_tracking_cost(bodies, reference, p)
    lower, upper = _torque_bounds(bodies, wrench, limits)
    count = len(lower)
    for robots in group_by_stance_count(reference.stance.sum(axis=1)):
        selection: EnvSelection = slice(None) if len(robots) == count else robots
        hessian, gradient = _cost(reference, foot_cost, selection, len(robots), p)
        constraint_matrix, force_lower, force_upper = _constraints(bodies, reference.stance, friction, selection)
        yield (
            robots,
            QpBatch(
                hessian,
                gradient,
                constraint_matrix,
                np.concatenate((lower[selection], force_lower), axis=1),
                np.concatenate((upper[selection], force_upper), axis=1),
                equalities=6,
            ),
        )


def _foot_tracking_cost(bodies: DynamicsTerms, reference: WholeBodyReference, p: MpcParameters) -> Floats:
    """Return the part of the whole-body QP's cost that penalises errors of the foot accelerations, (n, 18, 19).

    The first 18 columns are the Hessian Jᵀ W J, and the last column is the negative gradient Jᵀ W (a - J̇ q̇). J is the
    Jacobian of the feet, a their reference acceleration, q̇ the generalised velocity and W the diagonal matrix of the
    weights.
    """
    count, size = bodies.bias_force.shape
    jacobian = bodies.jacobians.reshape(count, -1, size)
    priority = np.where(reference.stance, p.standing_priority, p.swinging_priority)
    weight = priority.repeat(3, axis=1)[..., None]
    wanted = (reference.foot_acceleration - bodies.foot_bias_acceleration).reshape(weight.shape)
    weighted = np.concatenate((weight * jacobian, weight * wanted), axis=2)
    cost: Floats = np.matmul(jacobian.transpose(0, 2, 1), weighted)
    return cost


def _torque_bounds(bodies: DynamicsTerms, wrench: Floats, limits: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return the lower and upper bounds of M q̈ - Jᵀ f in the whole-body QP, (n, 18) each, N and N·m.

    M is the inertia matrix, q̈ the generalised acceleration, J the Jacobian of the feet and f the contact forces. The
    first 6 rows belong to the floating base, which has no motor: both bounds are the external wrench minus the bias
    force. In the 12 rows of the joints, the bounds are the torque limits minus the bias force.
    """
    bias = bodies.bias_force.copy()
    bias[:, :6] -= wrench
    lower = -bias
    upper = lower.copy()
    lower[:, 6:] += limits[0]
    upper[:, 6:] += limits[1]
    return lower, upper


def _cost(
    reference: WholeBodyReference, foot_cost: Floats, selection: EnvSelection, group: int, p: MpcParameters
) -> tuple[Floats, Floats]:
    """Return Hessian and gradient of the cost of the whole-body QPs of g selected robots.

    A QP has k variables: the 18 generalised accelerations and the force components of the stance feet.

    Args:
        reference: Accelerations and contact forces to track, for all n robots.
        foot_cost: Cost of the foot accelerations of all n robots from `_foot_tracking_cost`, (n, 18, 19).
        selection: Indices or slice of the g robots.
        group: Number g of selected robots.
        p: Parameters with the weights of the cost.

    Returns:
        hessian: Hessian with respect to the k variables, (g, k, k).
        gradient: Gradient at the point where all variables are zero, (g, k).
    """
    size = foot_cost.shape[1]
    stance = reference.stance[selection]
    planned_force = reference.contact_force[selection][stance].reshape(group, -1)
    forces = slice(size, size + planned_force.shape[1])
    hessian = np.zeros((group, forces.stop, forces.stop))
    hessian[:, :size, :size] = foot_cost[selection, :, :size]
    weights = np.full(forces.stop, JOINT_ACCELERATION_WEIGHT)
    weights[:6] = BASE_ACCELERATION_WEIGHT
    weights[forces] = p.force_priority
    weights[TRUNK_ROTATION] += p.turning_priority
    diagonal = np.arange(forces.stop)
    hessian[:, diagonal, diagonal] += weights
    gradient = np.zeros((group, forces.stop))
    gradient[:, TRUNK_ROTATION] = -p.turning_priority * reference.base_angular_acceleration[selection]
    gradient[:, :size] -= foot_cost[selection, :, size]
    gradient[:, forces] = -p.force_priority * planned_force
    return hessian, gradient


def _constraints(
    bodies: DynamicsTerms, stance: Mask, friction: Friction, selection: EnvSelection
) -> tuple[Floats, Floats, Floats]:
    """Return the constraint matrix of the whole-body QPs of g robots, and the bounds of its friction rows.

    The variables are the generalised acceleration q̈ and the k force components f of the stance feet. The first 18 rows
    of the matrix give M q̈ - Jᵀ f, with the inertia matrix M and the Jacobian J of the feet. The other rows are the
    friction constraints of the contact forces.

    Args:
        bodies: Inertia matrix, bias force, Jacobians and other dynamics terms of all n robots.
        stance: True for stance feet of all n robots, (n, 4). The g selected robots have equal numbers of stance feet.
        friction: Bounds of the contact forces of all n robots.
        selection: Indices or slice of the g robots.

    Returns:
        constraint_matrix: Constraint matrix, (g, 18 + 5 k / 3, 18 + k).
        force_lower: Lower bounds of the friction rows, (g, 5 k / 3), N.
        force_upper: Upper bounds of the friction rows, (g, 5 k / 3), N.
    """
    group, size = bodies.bias_force[selection].shape
    jacobian = bodies.jacobians[selection][stance[selection]].reshape(group, -1, size)
    num_forces = jacobian.shape[1]
    pyramid, force_lower, force_upper = friction_constraints(num_forces // 3, friction.select(selection))
    constraint_matrix = np.zeros((group, size + pyramid.shape[1], size + num_forces))
    constraint_matrix[:, :size, :size] = bodies.inertia[selection]
    constraint_matrix[:, :size, size:] = -jacobian.transpose(0, 2, 1)
    constraint_matrix[:, size:, size:] = pyramid
    return constraint_matrix, force_lower, force_upper


def leg_torques(
    bodies: DynamicsTerms, reference: WholeBodyReference, wrench: Floats, limits: tuple[Floats, Floats]
) -> Torques:
    """Compute the joint torques of each leg separately, from its contact force and foot acceleration.

    The policy `Mpc` uses this function instead of the whole-body QP. The torques are the joint rows of
    τ = M q̈ + h - Jᵀ f. M is the inertia matrix, h the bias force, J the Jacobian of the feet and f the planned contact
    forces. The trunk part of the generalised acceleration q̈ follows from the planned forces and the external wrench,
    and the joint part from the foot accelerations. The reaction of the trunk to the motion of the legs is neglected.
    The planned forces must be within the friction pyramid, because the function does not check them.

    Args:
        bodies: Inertia matrix, bias force, Jacobians and other dynamics terms of n robots.
        reference: Accelerations and contact forces to track.
        wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
            centre, base frame, N·m.
        limits: Minimum and maximum joint torques, (n, 12) each, N·m; the torques are clipped to them.

    Returns:
        Joint torques and joint accelerations; `has_solution` is False for robots with torques that are not finite.
    """
    forces = np.where(reference.stance[..., None], reference.contact_force, 0.0)
    linear = (forces.sum(axis=1) + wrench[:, :3]) / bodies.mass[:, None] - (0.0, 0.0, GRAVITY)
    trunk_acceleration = np.concatenate((linear, reference.base_angular_acceleration), axis=1)
    jacobian_transposed = bodies.leg_jacobians.swapaxes(2, 3)
    joint_acceleration = _leg_accelerations(bodies, reference.foot_acceleration, trunk_acceleration)
    acceleration = np.concatenate((trunk_acceleration, joint_acceleration), axis=1)
    needed = np.einsum("nij,nj->ni", bodies.inertia[:, 6:], acceleration) + bodies.bias_force[:, 6:]
    contact_torque = np.matmul(jacobian_transposed, forces[..., None])[..., 0].reshape(joint_acceleration.shape)
    torque = np.clip(needed - contact_torque, *limits)
    return Torques(torque, joint_acceleration, np.isfinite(torque).all(axis=1))


def _leg_accelerations(bodies: DynamicsTerms, foot_acceleration: Floats, trunk_acceleration: Floats) -> Floats:
    """Return the joint accelerations that give the feet their planned accelerations, (n, 12), rad/s².

    For each leg, they are the damped least-squares solution q̈ of J q̈ = a - b. J is the Jacobian of the foot with
    respect to the joints of the leg, and a the planned acceleration of the foot. b is the acceleration of the foot at
    q̈ = 0. `foot_acceleration`: planned accelerations of the feet, level frame (yaw only), (n, 4, 3), m/s²;
    `trunk_acceleration`: acceleration of the trunk, (n, 6): linear, level frame, m/s², then angular, base frame,
    rad/s².
    """
    trunk_part = np.einsum("nlxk,nk->nlx", bodies.jacobians[..., :6], trunk_acceleration)
    jacobian = bodies.leg_jacobians
    transposed = jacobian.swapaxes(2, 3)
    squares = np.matmul(transposed, jacobian) + _DAMPING * np.eye(3)
    leg_part = foot_acceleration - bodies.foot_bias_acceleration - trunk_part
    projected = np.matmul(transposed, leg_part[..., None])
    return np.linalg.solve(squares, projected)[..., 0].reshape(len(trunk_acceleration), 12)
