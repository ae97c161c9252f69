"""The robot as one rigid body on its feet, predicted over a horizon, and the forces that move it best.

Di Carlo et al., "Dynamic locomotion in the MIT Cheetah 3 through convex model-predictive control", IROS 2018, with the
states eliminated: the variables are the forces of the feet that stand. In a level frame at the robot's heading, small
tilts and a constant inertia make the prediction linear: with accelerations constant over each step of τ s,

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
_EYE = np.eye(3)
_FALL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY])
MAX_GROUP_SIZE = 32
"""Robots whose programs are made at once: their matrices fit into a processor's cache."""


class RigidBodyState(NamedTuple):
    """Rigid bodies of n robots now, each in a level frame with its origin at the centre of mass, x ahead."""

    pose: Floats
    """Roll, pitch and yaw, rad, and the centre of mass, the origin being where it is to be, m; (n, 6)."""
    rate: Floats
    """Angular velocity, rad/s, and velocity, m/s, (n, 6)."""
    mass: Floats
    """(n,), kg."""
    inertia: Floats
    """About the centre of mass, (n, 3, 3), kg·m²."""
    acceleration: Floats
    """What no foot explains: angular, rad/s², and linear, m/s², (n, 6)."""


class MpcWeights(NamedTuple):
    """Of the squares in the cost, (6,) each, and of the squared forces."""

    pose: Floats
    rate: Floats
    force: float
    """Of the squared differences from forces that share the weight among the feet that stand: from none at all, and the
    plan sinks towards its end."""


class MpcReference(NamedTuple):
    """Where n bodies are to be after each step of the horizon, and how they are to move; (n, N or 1, 6)."""

    pose: Floats
    rate: Floats


class Friction(NamedTuple):
    """Bounds of the force of a stance foot of each robot."""

    coefficient: Floats
    """Largest horizontal force along each axis, per vertical; (n,)."""
    max_normal_force: Floats
    """Vertical, (n,), N."""

    def select(self, robots: EnvSelection) -> "Friction":
        """Those of some robots."""
        return Friction(self.coefficient[robots], self.max_normal_force[robots])


@dataclass(eq=False)
class CondensedMpc:
    """A prediction over `steps` steps of `period` s, and what its cost weighs; all else follows from these."""

    steps: int
    period: float
    weights: MpcWeights

    def __post_init__(self) -> None:
        steps, period, weights = self.steps, self.period, self.weights
        k, j = np.arange(1, steps + 1)[:, None], np.arange(steps)
        before = j < k
        self.velocity_response = np.where(before, period, 0.0)
        """Velocity after step k per acceleration in step j, (N, N), s."""
        self.position_response = np.where(before, period**2 * (k - j - 0.5), 0.0)
        """Position after step k per acceleration in step j, (N, N), s²."""
        self.step_ends: Floats = period * np.arange(1.0, steps + 1.0)
        """Ends of the steps, (N,), s."""
        self.step_middles: Floats = self.step_ends - 0.5 * period
        """Their middles, (N,), s."""
        roots = [
            self._root(position_response, velocity_response)
            for position_response, velocity_response in zip(weights.pose, weights.rate, strict=True)
        ]
        self._roots = np.stack(roots, axis=1).transpose(2, 1, 0).copy()  # (step, axis, row of the root)

    def _root(self, place: float, rate: float) -> Floats:
        """R with RᵀR the cost's matrix of the accelerations along one axis, (N, N)."""
        stacked = np.concatenate((np.sqrt(place) * self.position_response, np.sqrt(rate) * self.velocity_response))
        return np.linalg.qr(stacked)[1]

    def free_response(self, body: RigidBodyState) -> MpcReference:
        """Where the bodies go by themselves, gravity and what no foot explains included."""
        acceleration, velocity_response, t = (
            (body.acceleration - _FALL)[:, None],
            body.rate[:, None],
            self.step_ends[:, None],
        )
        return MpcReference(
            body.pose[:, None] + t * velocity_response + 0.5 * t * t * acceleration,
            velocity_response + t * acceleration,
        )

    def make_programs(
        self, body: RigidBodyState, arms: Floats, stance: Mask, wanted: MpcReference, friction: Friction
    ) -> Iterator[tuple[EnvIndices, QpBatch]]:
        """The forces' programs, those of one shape together, with the robots whose they are.

        Variables are those of the feet that stand, (step, foot, axis) in order. `arms`: feet from the centre of mass in
        each step, (n, N, 4, 3), m; `stance`: which of them stand, (n, N, 4).
        """
        weights, count = self.weights, len(arms)
        # Angular and linear acceleration by each variable, (n, variable, 6).
        moved: Floats = np.zeros((count, self.steps * LEGS, 3, 6))
        turned = np.matmul(skew(-arms).reshape(count, -1, 3), np.linalg.inv(body.inertia))  # which is symmetric
        moved[..., :3] = turned.reshape(count, -1, 3, 3)
        moved[..., 3:] = _EYE / body.mass[:, None, None, None]
        moved, free_response = moved.reshape(count, -1, 6), self.free_response(body)
        pull = np.matmul(self.position_response.T, weights.pose * (free_response.pose - wanted.pose))
        pull += np.matmul(self.velocity_response.T, weights.rate * (free_response.rate - wanted.rate))
        gradient = np.matmul(moved.reshape(count, self.steps, 3 * LEGS, 6), pull[..., None]).reshape(count, -1)
        coefficient = body.mass[:, None] * GRAVITY / np.maximum(stance.sum(axis=2), 1)
        gradient.reshape(count, self.steps, LEGS, 3)[..., 2] -= weights.force * coefficient[..., None]
        kept = stance.reshape(count, -1).repeat(3, axis=1)
        for robots in group_by_stance_count(stance.sum(axis=(1, 2))):
            chosen = np.nonzero(kept[robots])[1].reshape(len(robots), -1)
            of_these = robots[:, None]
            roots = self._roots[chosen // (3 * LEGS)] * moved[of_these, chosen][..., None]
            roots = roots.reshape(*chosen.shape, 6 * self.steps)
            hessian = np.matmul(roots, roots.transpose(0, 2, 1))
            hessian.reshape(len(robots), -1)[:, :: chosen.shape[1] + 1] += weights.force  # on the diagonals
            bounds = friction_constraints(chosen.shape[1] // 3, friction.select(robots))
            yield robots, QpBatch(hessian, gradient[of_these, chosen], *bounds)

    def scatter_forces(self, solution: Floats, stance: Mask) -> Floats:
        """Forces of every foot in every step, (g, N, 4, 3), N, zero where it does not stand, of solutions (g, k)."""
        forces = np.zeros((*stance.shape, 3))
        forces[stance] = solution.reshape(-1, 3)
        return forces


def group_by_stance_count(counts: NDArray[np.int64]) -> Iterator[EnvIndices]:
    """Robots with the same count, (n,), of feet that stand, the smallest count first, at most `TOGETHER` at once."""
    for count in sorted(set(counts.tolist())):
        robots = (counts == count).nonzero()[0]
        yield from (robots[start : start + MAX_GROUP_SIZE] for start in range(0, len(robots), MAX_GROUP_SIZE))


@cache
def _pyramids(feet: int) -> tuple[Floats, Floats, EnvIndices]:
    """Rows of the forces of so many feet without friction, their lower bounds, and the flat places of the friction."""
    one = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    friction = np.kron(np.eye(feet), [[0, 0, 1]] * 4 + [[0, 0, 0]])
    return np.kron(np.eye(feet), one), np.tile([*4 * [-np.inf], 0.0], feet), np.flatnonzero(friction)


def friction_constraints(feet: int, friction: Friction) -> tuple[Floats, Floats, Floats]:
    """Rows of the forces of so many feet of each robot, (n, 5 feet, 3 feet), with their bounds: a pyramid, and the
    vertical force."""
    template, least, places = _pyramids(feet)
    rows, upper = (
        template[None].repeat(len(friction.coefficient), axis=0),
        np.zeros((len(friction.coefficient), 5 * feet)),
    )
    rows.reshape(len(rows), -1)[:, places] = -friction.coefficient[:, None]
    upper[:, 4::5] = friction.max_normal_force[:, None]
    return rows, least[None].repeat(len(rows), axis=0), upper
