"""Condensed MPC: optimal contact forces over a prediction horizon for a robot modelled as a single rigid body.

The method is by Di Carlo et al., "Dynamic locomotion in the MIT Cheetah 3 through convex model-predictive control",
IROS 2018. In condensed MPC, the states are eliminated, so that the only variables are the forces of the stance feet.
The prediction is linear in the forces, because the tilt is assumed to be small and the inertia to be constant. The
acceleration a_j is constant over step j of duration τ. Velocity v_k and position p_k after step k are

    v_k = v_0 + τ Σ_{j<k} a_j        p_k = p_0 + kτ v_0 + τ² Σ_{j<k} (k - j - ½) a_j

with a_j = Σ_i f_ij / m + g. f_ij is the force on foot i in step j, m the mass and g the acceleration of gravity. The
equations also hold for the angles, with the angular acceleration α_j = I⁻¹ Σ_i r_ij × f_ij. I is the rotational inertia
and r_ij is the vector from the centre of mass to foot i in step j.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.mpc.quadratic_program import QpBatch
from quad_env.columns import EnvIndices, EnvSelection, Mask
from quad_env.config import GRAVITY
from quad_env.physics.rotations import skew

LEGS = 4
"""Number of legs of a robot."""
MAX_GROUP_SIZE = 32
"""Largest number of robots in one batch of quadratic programs.

The number is limited so that the matrices of a batch fit into a processor cache."""
_EYE = np.eye(3)
_GRAVITY_ACCELERATION = np.array([0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY])
"""Acceleration of gravity as a positive number on the z axis, (6,): angular (zero), rad/s², then linear, m/s².

The array is subtracted from the acceleration that the external wrench on a body causes."""


class RigidBodyState(NamedTuple):
    """States of n robots that the MPC models as single rigid bodies.

    Vectors are in the level frame of the robot: x along the heading, z up, origin at the centre of mass.
    """

    pose: Floats
    """Deviation of the body from its present reference, level frame (yaw only), (n, 6).

    The numbers are roll, pitch and yaw, rad, then the position x, y, z, m."""
    rate: Floats
    """Velocities of the robots, (n, 6): angular velocity of the trunk, rad/s, then velocity of the centre of mass, m/s.

    Both are in the level frame (x along the heading of the robot, z up)."""
    mass: Floats
    """Mass of each robot with its load, (n,), kg."""
    inertia: Floats
    """Rotational inertia of each robot about its centre of mass, level frame (yaw only), (n, 3, 3), kg·m²."""
    acceleration: Floats
    """Acceleration that the external wrench causes, level frame, (n, 6): angular, rad/s², then linear, m/s².

    The level frame turns only with the yaw of the robot, and its z axis points up.
    """


class MpcWeights(NamedTuple):
    """Weights of the quadratic cost of the MPC, which penalises errors of pose and velocity and uneven forces."""

    pose: Floats
    """Weights of the squared pose errors in the cost, (6,): roll, pitch, yaw, 1/rad², then position x, y, z, 1/m²."""
    rate: Floats
    """Weights of the squared rate errors in the cost, (6,): angular velocity, s²/rad², then velocity, s²/m²."""
    force: float
    """Weight of the squared deviation of the contact forces from an even distribution over the stance feet, 1/N².

    In the even distribution, the stance feet carry equal parts of the robot's weight. A cost of the squared forces
    themselves would let the planned body sink towards the end of the horizon."""


class MpcReference(NamedTuple):
    """Trajectory of n bodies over the MPC horizon: angles, positions and velocities after each of the N steps.

    It is the reference that the MPC tracks, or a predicted trajectory.
    """

    pose: Floats
    """Pose of each body after each of the N steps of the horizon, level frame (yaw only), (n, N, 6).

    The numbers are roll, pitch and yaw, rad, then the position x, y, z, m."""
    rate: Floats
    """Velocities after each of the N steps, level frame, (n, N, 6): angular velocity, rad/s, then velocity, m/s.

    The level frame turns only with the yaw of the robot, and its z axis points up.

    The shape (n, 1, 6) stands for a constant rate."""


class Friction(NamedTuple):
    """Bounds of the contact force on a stance foot (friction pyramid), for each of n robots."""

    coefficient: Floats
    """Friction coefficient of each robot, (n,): largest horizontal force along each axis per vertical force."""
    max_normal_force: Floats
    """Largest vertical force on one foot of each robot, (n,), N."""

    def select(self, robots: EnvSelection) -> "Friction":
        """Return the bounds for a selection of robots; `robots` are the indices of these robots or a slice."""
        return Friction(self.coefficient[robots], self.max_normal_force[robots])


@dataclass(eq=False)
class CondensedMpc:
    """Assembles the quadratic programs for the contact forces over a horizon of N steps (condensed MPC).

    The only variables of a program are the forces of the stance feet, because the states are eliminated.
    """

    steps: int
    """Number of steps N of the prediction horizon of the MPC."""
    period: float
    """Duration of a step of the prediction horizon of the MPC, s."""
    weights: MpcWeights
    """Weights of the quadratic cost of the MPC."""

    def __post_init__(self) -> None:
        k = np.arange(1, self.steps + 1)[:, None]
        j = np.arange(self.steps)
        is_before = j < k
        self.velocity_response = np.where(is_before, self.period, 0.0)
        """Change of the velocity at the end of horizon step k (row) per acceleration in step j (column), (N, N), s."""
        self.position_response = np.where(is_before, self.period**2 * (k - j - 0.5), 0.0)
        """Change of the position at the end of horizon step k (row) per acceleration in step j (column), (N, N), s²."""
        self.step_ends: Floats = self.period * np.arange(1.0, self.steps + 1.0)
        """Time from now to the end of each of the N steps of the horizon, (N,), s."""
        self.step_middles: Floats = self.step_ends - 0.5 * self.period
        """Time from now to the middle of each of the N steps of the horizon, (N,), s."""
        axes = zip(self.weights.pose, self.weights.rate, strict=True)
        roots = [self._cost_root(pose_weight, rate_weight) for pose_weight, rate_weight in axes]
        self._roots = np.stack(roots, axis=1).transpose(2, 1, 0).copy()
        """Matrix square roots R, (N, N), of the cost of the accelerations, for each of the 6 axes, (N, 6, N).

        The cost of the N accelerations a along an axis is |R a|². The indices of the array are the column of R (the
        horizon step of the acceleration), the axis, and the row of R."""

    def _cost_root(self, pose_weight: float, rate_weight: float) -> Floats:
        """Return the matrix square root R, (N, N), of the cost of the accelerations along one axis.

        The axis is roll, pitch, yaw, x, y or z. The cost of the accelerations a along it, in the N steps of the
        horizon, is |R a|². `pose_weight` and `rate_weight` are the weights of the squared position and velocity errors
        along the axis.
        """
        stacked = np.concatenate(
            (np.sqrt(pose_weight) * self.position_response, np.sqrt(rate_weight) * self.velocity_response)
        )
        return np.linalg.qr(stacked)[1]

    def free_response(self, body: RigidBodyState) -> MpcReference:
        """Predict pose and velocities of each `body` after each step of the horizon if the feet apply no forces.

        Only gravity and the external wrench act on a body then.
        """
        acceleration = (body.acceleration - _GRAVITY_ACCELERATION)[:, None]
        rate = body.rate[:, None]
        t = self.step_ends[:, None]
        return MpcReference(body.pose[:, None] + t * rate + 0.5 * t * t * acceleration, rate + t * acceleration)

    def make_programs(
        self, body: RigidBodyState, moment_arms: Floats, stance: Mask, reference: MpcReference, friction: Friction
    ) -> Iterator[tuple[EnvIndices, QpBatch]]:
        """Yield the quadratic programs for the contact forces, in batches with equal numbers of variables.

        The variables of a robot's program are the forces of its stance feet in all steps of the horizon. They are
        ordered by step, then foot, then axis.

        Args:
            body: Present state of n robots.
            moment_arms: Vectors from the centre of mass to the feet in each of the N steps of the horizon, level frame
                (yaw only), (n, N, 4, 3), m.
            stance: True for stance feet in each step of the horizon, (n, N, 4).
            reference: Reference trajectory of the bodies.
            friction: Bounds of the contact forces.

        Yields:
            Indices of the g robots of a batch, (g,), and the quadratic programs of these robots.
        """
        count = len(moment_arms)
        accelerations = self._accelerations_by_force(body, moment_arms)
        gradient = self._gradient(body, stance, reference, accelerations)
        is_variable = stance.reshape(count, -1).repeat(3, axis=1)
        for robots in group_by_stance_count(stance.sum(axis=(1, 2))):
            variables = np.nonzero(is_variable[robots])[1].reshape(len(robots), -1)
            rows = robots[:, None]
            hessian = self._hessian(accelerations[rows, variables], variables)
            bounds = friction_constraints(variables.shape[1] // 3, friction.select(robots))
            yield robots, QpBatch(hessian, gradient[rows, variables], *bounds)

    def _accelerations_by_force(self, body: RigidBodyState, moment_arms: Floats) -> Floats:
        """Return the acceleration of the body per component of each contact force, level frame, (n, 12 N, 6).

        The level frame turns only with the yaw of the robot, and its z axis points up.

        The 12 N rows are ordered by step of the horizon, then foot, then axis of the force. A row has the angular
        acceleration, rad/s² per newton, then the linear acceleration, m/s² per newton. `moment_arms`: vectors from the
        centre of mass to the feet, level frame, (n, N, 4, 3), m.
        """
        count = len(moment_arms)
        accelerations: Floats = np.zeros((count, self.steps * LEGS, 3, 6))
        angular = np.matmul(
            skew(-moment_arms).reshape(count, -1, 3), np.linalg.inv(body.inertia)
        )  # The inverse inertia is not transposed, because it is symmetric.
        accelerations[..., :3] = angular.reshape(count, -1, 3, 3)
        accelerations[..., 3:] = _EYE / body.mass[:, None, None, None]
        return accelerations.reshape(count, -1, 6)

    def _gradient(self, body: RigidBodyState, stance: Mask, reference: MpcReference, accelerations: Floats) -> Floats:
        """Return the gradient of the cost with respect to all contact forces, at zero forces.

        Args:
            body: Present state of n robots.
            stance: True for stance feet in each of the N steps of the horizon, (n, N, 4).
            reference: Reference trajectory of the bodies.
            accelerations: Acceleration of the body per force component, from `_accelerations_by_force`, (n, 12 N, 6).

        Returns:
            Gradient, ordered by step of the horizon, then foot, then axis, (n, 12 N), 1/newton.
        """
        count = len(stance)
        weights = self.weights
        free_response = self.free_response(body)
        pull = np.matmul(self.position_response.T, weights.pose * (free_response.pose - reference.pose))
        pull += np.matmul(self.velocity_response.T, weights.rate * (free_response.rate - reference.rate))
        by_step = accelerations.reshape(count, self.steps, 3 * LEGS, 6)
        gradient: Floats = np.matmul(by_step, pull[..., None]).reshape(count, -1)
        even_force = body.mass[:, None] * GRAVITY / np.maximum(stance.sum(axis=2), 1)
        gradient.reshape(count, self.steps, LEGS, 3)[..., 2] -= weights.force * even_force[..., None]
        return gradient

    def _hessian(self, accelerations: Floats, variables: EnvIndices) -> Floats:
        """Return the Hessian of the cost with respect to the k variables (force components) of each of g robots.

        Args:
            accelerations: Acceleration of the body per variable, (g, k, 6): angular, then linear.
            variables: Indices of the variables among the force components of all 4 feet in all N steps, (g, k).

        Returns:
            Hessian matrices, (g, k, k), 1/newton².
        """
        roots = self._roots[variables // (3 * LEGS)] * accelerations[..., None]
        roots = roots.reshape(*variables.shape, 6 * self.steps)
        hessian: Floats = np.matmul(roots, roots.transpose(0, 2, 1))
        diagonal = np.arange(variables.shape[1])
        hessian[:, diagonal, diagonal] += self.weights.force
        return hessian

    def scatter_forces(self, solution: Floats, stance: Mask) -> Floats:
        """Return the contact force of every foot in every step of the horizon.

        The solutions of the quadratic programs contain only the forces of the stance feet.

        Args:
            solution: Optimal force components of the stance feet of g robots, ordered by step, then foot, then axis,
                (g, k), N.
            stance: True for stance feet in each of the N steps of the horizon, (g, N, 4).

        Returns:
            Contact forces, level frame (yaw only), (g, N, 4, 3), N; zero for feet in the air.
        """
        forces = np.zeros((*stance.shape, 3))
        forces[stance] = solution.reshape(-1, 3)
        return forces


def group_by_stance_count(counts: NDArray[np.int64]) -> Iterator[EnvIndices]:
    """Yield the indices, (g,), of the robots in each group of robots that have equal numbers of stance feet.

    The quadratic programs of a group have equal sizes, so that they form one batch. A group has at most
    `MAX_GROUP_SIZE` robots. `counts`: number of stance feet of each robot, now or summed over the horizon, (n,).
    """
    for count in sorted(set(counts.tolist())):
        robots = (counts == count).nonzero()[0]
        yield from (robots[start : start + MAX_GROUP_SIZE] for start in range(0, len(robots), MAX_GROUP_SIZE))


class PyramidTemplate(NamedTuple):
    """Constraints on the contact forces of k feet, with zeros in place of the friction coefficients.

    `friction_constraints` copies the template and fills in the friction coefficient of each robot.
    """

    constraint_matrix: Floats
    """Constraint matrix of the forces of k feet, with zeros in place of the friction coefficients, (5 k, 3 k)."""
    lower: Floats
    """Lower bounds of the five constraints of each of k feet, (5 k,), N: -inf for friction, 0 for the vertical force.
    """
    friction_entries: EnvIndices
    """Indices of the elements of the flattened constraint matrix that become minus the friction coefficient, (4 k,)."""


@cache
def _pyramid_template(feet: int) -> PyramidTemplate:
    """Return the template of the constraints on the contact forces f of a number of `feet`.

    Each foot has five constraints: ±f_x - μ f_z ≤ 0, ±f_y - μ f_z ≤ 0 and 0 ≤ f_z ≤ maximum. μ is the friction
    coefficient and f_z the vertical force.
    """
    one_foot = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    friction_entries = np.kron(np.eye(feet), [[0, 0, 1]] * 4 + [[0, 0, 0]])
    lower = np.tile([*4 * [-np.inf], 0.0], feet)
    return PyramidTemplate(np.kron(np.eye(feet), one_foot), lower, np.flatnonzero(friction_entries))


def friction_constraints(feet: int, friction: Friction) -> tuple[Floats, Floats, Floats]:
    """Return the constraints on the contact forces: friction pyramid and limits of the vertical force.

    The constraints are lower ≤ A f ≤ upper, with all force components f of a robot in one vector.

    Args:
        feet: Number k of contact forces of each robot.
        friction: Friction coefficients and largest vertical forces of g robots.

    Returns:
        constraint_matrix: Constraint matrix A, (g, 5 k, 3 k).
        lower: Lower bounds, (g, 5 k), N.
        upper: Upper bounds, (g, 5 k), N.
    """
    template = _pyramid_template(feet)
    count = len(friction.coefficient)
    constraint_matrix = template.constraint_matrix[None].repeat(count, axis=0)
    constraint_matrix.reshape(count, -1)[:, template.friction_entries] = -friction.coefficient[:, None]
    upper = np.zeros((count, 5 * feet))
    upper[:, 4::5] = friction.max_normal_force[:, None]
    return constraint_matrix, template.lower[None].repeat(count, axis=0), upper
