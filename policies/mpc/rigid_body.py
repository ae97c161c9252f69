"""Condensed MPC: optimal contact forces for the robot as a single rigid body over a horizon.

The method is by Di Carlo et al., "Dynamic locomotion in the MIT Cheetah 3 through convex model-predictive control",
IROS 2018. Here the states are eliminated, so that the only variables are the forces of the stance feet. The prediction
is linear in the level frame if tilts are small and the inertia is constant. With an acceleration a_j that is constant
over each step of duration τ,

    v_k = v_0 + τ Σ_{j<k} a_j        p_k = p_0 + kτ v_0 + τ² Σ_{j<k} (k - j - ½) a_j

where a_j = Σ_i f_ij / m + g, and the same for angles with α_j = I⁻¹ Σ_i r_ij × f_ij.
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
"""Number of legs."""
MAX_GROUP_SIZE = 32
"""Largest number of robots in a batch of programs, so that the matrices of a batch fit into a processor cache."""
_EYE = np.eye(3)
_GRAVITY_ACCELERATION = np.array([0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY])
"""Magnitude of the downward acceleration of a falling body: angular, rad/s², then linear, m/s², (6,)."""


class RigidBodyState(NamedTuple):
    """States of n robots as single rigid bodies, in level frames with the origin at the centre of mass."""

    pose: Floats
    """Roll, pitch and yaw, rad, then the position of the centre of mass relative to its reference, m; (n, 6)."""
    rate: Floats
    """Angular velocity, rad/s, then velocity, m/s, (n, 6)."""
    mass: Floats
    """Mass, (n,), kg."""
    inertia: Floats
    """Rotational inertia about the centre of mass, (n, 3, 3), kg·m²."""
    acceleration: Floats
    """Acceleration by the external wrench: angular, rad/s², then linear, m/s², (n, 6)."""


class MpcWeights(NamedTuple):
    """Weights of the cost of the MPC."""

    pose: Floats
    """Weights of the squared errors of the pose, (6,)."""
    rate: Floats
    """Weights of the squared errors of the rate, (6,)."""
    force: float
    """Weight of the squared differences between the forces and an even distribution of the weight over the stance feet.

    A cost of the squared forces themselves would let the planned body sink towards the end of the horizon."""


class MpcReference(NamedTuple):
    """Reference of n bodies after each step of the horizon."""

    pose: Floats
    """Reference of `RigidBodyState.pose`, (n, N, 6)."""
    rate: Floats
    """Reference of `RigidBodyState.rate`, (n, N or 1, 6)."""


class Friction(NamedTuple):
    """Bounds of the contact force on a stance foot, for each of n robots."""

    coefficient: Floats
    """Largest horizontal force along each axis, per vertical force, (n,)."""
    max_normal_force: Floats
    """Largest vertical force, (n,), N."""

    def select(self, robots: EnvSelection) -> "Friction":
        """Return the bounds of the robots with indices `robots`."""
        return Friction(self.coefficient[robots], self.max_normal_force[robots])


@dataclass(eq=False)
class CondensedMpc:
    """Condensed MPC over a fixed horizon: assembles the quadratic programs of the contact forces."""

    steps: int
    """Number of steps, N."""
    period: float
    """Duration of a step, s."""
    weights: MpcWeights
    """Weights of the cost."""

    def __post_init__(self) -> None:
        k = np.arange(1, self.steps + 1)[:, None]
        j = np.arange(self.steps)
        is_before = j < k
        self.velocity_response = np.where(is_before, self.period, 0.0)
        """Velocity after step k per acceleration in step j, (N, N), s."""
        self.position_response = np.where(is_before, self.period**2 * (k - j - 0.5), 0.0)
        """Position after step k per acceleration in step j, (N, N), s²."""
        self.step_ends: Floats = self.period * np.arange(1.0, self.steps + 1.0)
        """Ends of the steps, (N,), s."""
        self.step_middles: Floats = self.step_ends - 0.5 * self.period
        """Middles of the steps, (N,), s."""
        axes = zip(self.weights.pose, self.weights.rate, strict=True)
        roots = [self._cost_root(pose_weight, rate_weight) for pose_weight, rate_weight in axes]
        self._roots = np.stack(roots, axis=1).transpose(2, 1, 0).copy()
        """Square roots of the cost of the accelerations, (step, axis, row of the root)."""

    def _cost_root(self, pose_weight: float, rate_weight: float) -> Floats:
        """Return the matrix R, (N, N): RᵀR is the cost matrix of the accelerations along one axis."""
        stacked = np.concatenate(
            (np.sqrt(pose_weight) * self.position_response, np.sqrt(rate_weight) * self.velocity_response)
        )
        return np.linalg.qr(stacked)[1]

    def free_response(self, body: RigidBodyState) -> MpcReference:
        """Predict pose and rate after each step if only gravity and the external wrench act on `body`."""
        acceleration = (body.acceleration - _GRAVITY_ACCELERATION)[:, None]
        rate = body.rate[:, None]
        t = self.step_ends[:, None]
        return MpcReference(body.pose[:, None] + t * rate + 0.5 * t * t * acceleration, rate + t * acceleration)

    def make_programs(
        self, body: RigidBodyState, moment_arms: Floats, stance: Mask, reference: MpcReference, friction: Friction
    ) -> Iterator[tuple[EnvIndices, QpBatch]]:
        """Yield the quadratic programs of the contact forces, in groups with equal numbers of variables.

        The variables are the forces of the stance feet, ordered by step, then foot, then axis.

        Args:
            body: Present state of n robots.
            moment_arms: Vectors from the centre of mass to the feet in each step, (n, N, 4, 3), m.
            stance: Stance feet in each step, (n, N, 4).
            reference: Reference of the bodies.
            friction: Bounds of the forces.

        Yields:
            Indices of g robots, (g,), and their programs.
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
        """Return the angular and linear acceleration per force of each foot in each step, (n, 12 N, 6)."""
        count = len(moment_arms)
        accelerations: Floats = np.zeros((count, self.steps * LEGS, 3, 6))
        angular = np.matmul(
            skew(-moment_arms).reshape(count, -1, 3), np.linalg.inv(body.inertia)
        )  # no transpose is needed, because the inertia is symmetric
        accelerations[..., :3] = angular.reshape(count, -1, 3, 3)
        accelerations[..., 3:] = _EYE / body.mass[:, None, None, None]
        return accelerations.reshape(count, -1, 6)

    def _gradient(self, body: RigidBodyState, stance: Mask, reference: MpcReference, accelerations: Floats) -> Floats:
        """Return the gradient of the cost at zero forces of all feet, (n, 12 N)."""
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
        """Return the Hessian of the cost of g robots.

        Args:
            accelerations: Accelerations per variable, (g, k, 6).
            variables: Indices of the variables among the forces of all feet, (g, k).

        Returns:
            Hessian, (g, k, k).
        """
        roots = self._roots[variables // (3 * LEGS)] * accelerations[..., None]
        roots = roots.reshape(*variables.shape, 6 * self.steps)
        hessian: Floats = np.matmul(roots, roots.transpose(0, 2, 1))
        diagonal = np.arange(variables.shape[1])
        hessian[:, diagonal, diagonal] += self.weights.force
        return hessian

    def scatter_forces(self, solution: Floats, stance: Mask) -> Floats:
        """Return the force on every foot in every step, from the variables of the programs.

        Args:
            solution: Variables of g programs, (g, k), N.
            stance: Stance feet in each step, (g, N, 4).

        Returns:
            Forces, zero for feet in the air, level frame, (g, N, 4, 3), N.
        """
        forces = np.zeros((*stance.shape, 3))
        forces[stance] = solution.reshape(-1, 3)
        return forces


def group_by_stance_count(counts: NDArray[np.int64]) -> Iterator[EnvIndices]:
    """Yield indices of at most MAX_GROUP_SIZE robots with the same number of stance feet, `counts`, (n,)."""
    for count in sorted(set(counts.tolist())):
        robots = (counts == count).nonzero()[0]
        yield from (robots[start : start + MAX_GROUP_SIZE] for start in range(0, len(robots), MAX_GROUP_SIZE))


class PyramidTemplate(NamedTuple):
    """Constraints of the friction pyramids of k feet, in which the friction coefficient is still missing."""

    constraint_matrix: Floats
    """Constraint matrix with zeros in place of the friction coefficients, (5 k, 3 k)."""
    lower: Floats
    """Lower bounds, (5 k,)."""
    friction_entries: EnvIndices
    """Flat indices of the entries of the matrix that are minus the friction coefficient."""


@cache
def _pyramid_template(feet: int) -> PyramidTemplate:
    """Return the template for a number of feet: ±fx - μ fz ≤ 0, ±fy - μ fz ≤ 0, 0 ≤ fz ≤ maximum."""
    one_foot = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    friction_entries = np.kron(np.eye(feet), [[0, 0, 1]] * 4 + [[0, 0, 0]])
    lower = np.tile([*4 * [-np.inf], 0.0], feet)
    return PyramidTemplate(np.kron(np.eye(feet), one_foot), lower, np.flatnonzero(friction_entries))


def friction_constraints(feet: int, friction: Friction) -> tuple[Floats, Floats, Floats]:
    """Return the constraints on the contact forces: a friction pyramid, and bounds of the vertical force.

    Args:
        feet: Number of stance feet of each robot, k.
        friction: Bounds of g robots.

    Returns:
        constraint_matrix: Constraint matrix, (g, 5 k, 3 k).
        lower: Lower bounds, (g, 5 k).
        upper: Upper bounds, (g, 5 k).
    """
    template = _pyramid_template(feet)
    count = len(friction.coefficient)
    constraint_matrix = template.constraint_matrix[None].repeat(count, axis=0)
    constraint_matrix.reshape(count, -1)[:, template.friction_entries] = -friction.coefficient[:, None]
    upper = np.zeros((count, 5 * feet))
    upper[:, 4::5] = friction.max_normal_force[:, None]
    return constraint_matrix, template.lower[None].repeat(count, axis=0), upper
