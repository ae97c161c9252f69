"""The robot as one rigid body on its feet, predicted over a horizon, and the forces that move it best.

Di Carlo et al., "Dynamic locomotion in the MIT Cheetah 3 through convex model-predictive control", IROS 2018, with the
states eliminated: the variables are the forces of the feet that stand. In a level frame at the robot's heading, small
tilts and a constant inertia make the prediction linear: with accelerations constant over each step of τ s,

    v_k = v_0 + τ Σ_{j<k} a_j        p_k = p_0 + kτ v_0 + τ² Σ_{j<k} (k - j - ½) a_j

where a_j = Σ_i f_ij / m + g, and the same for angles with α_j = I⁻¹ Σ_i r_ij × f_ij.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.mpc.quadratic_program import Program
from quad_env.config import GRAVITY

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Body(NamedTuple):
    """One robot's rigid body now, in a level frame with its origin at the centre of mass, x ahead."""

    angles: Floats
    """Roll, pitch and yaw, (3,), rad."""
    position: Floats
    """Of the centre of mass, the origin being where it is to be; (3,), m."""
    turning: Floats
    """Angular velocity, (3,), rad/s."""
    velocity: Floats
    """(3,), m/s."""
    mass: float
    """kg."""
    inertia: Floats
    """About the centre of mass, (3, 3), kg·m²."""
    acceleration: Floats
    """What no foot explains: linear, m/s², and angular, rad/s², (6,)."""


class Weights(NamedTuple):
    """Of the squares in the cost, (3,) each, and of the squared forces."""

    angles: Floats
    position: Floats
    turning: Floats
    velocity: Floats
    force: float


class Reference(NamedTuple):
    """Where the body is to be after each step of the horizon, (N, 3) each."""

    angles: Floats
    position: Floats
    turning: Floats
    velocity: Floats


class Friction(NamedTuple):
    """Bounds of the force of a standing foot."""

    share: float
    """Largest horizontal force along each axis, per vertical."""
    least: float
    """Vertical, N."""
    most: float
    """Vertical, N."""


class Horizon:
    """A prediction over `steps` steps of `period` s."""

    def __init__(self, steps: int, period: float) -> None:
        self.steps, self.period = steps, period
        k, j = np.arange(1, steps + 1)[:, None], np.arange(steps)
        before = j < k
        self.rate = np.where(before, period, 0.0)
        """Velocity after step k per acceleration in step j, (N, N), s."""
        self.place = np.where(before, period**2 * (k - j - 0.5), 0.0)
        """Position after step k per acceleration in step j, (N, N), s²."""
        self.times: Floats = period * np.arange(1.0, steps + 1.0)
        """Ends of the steps, (N,), s."""
        self.middles: Floats = self.times - 0.5 * period
        """Their middles, (N,), s."""
        self._rate_square, self._place_square = self.rate.T @ self.rate, self.place.T @ self.place

    @staticmethod
    def moments(inertia: Floats, arms: Floats) -> Floats:
        """Angular acceleration of a body of that inertia, (3, 3), per force of each foot in each step, (N, 4, 3, 3),
        from `arms`, (N, 4, 3), m, of the feet from the centre of mass."""
        x, y, z = np.moveaxis(arms, -1, 0)
        zero = np.zeros_like(x)
        crossed = np.stack((zero, -z, y, z, zero, -x, -y, x, zero), axis=-1).reshape(*x.shape, 3, 3)
        return np.asarray(np.linalg.inv(inertia) @ crossed)

    def free(self, body: Body) -> Reference:
        """Where the body goes by itself, gravity and what no foot explains included."""
        linear, angular = body.acceleration[:3] - (0.0, 0.0, GRAVITY), body.acceleration[3:]
        t = self.times[:, None]
        return Reference(
            body.angles + t * body.turning + 0.5 * t * t * angular,
            body.position + t * body.velocity + 0.5 * t * t * linear,
            body.turning + t * angular,
            body.velocity + t * linear,
        )

    def program(
        self, body: Body, arms: Floats, standing: Bools, wanted: Reference, weights: Weights, friction: Friction
    ) -> Program:
        """The forces' program; variables are those of the feet that stand, (step, foot, axis) in order.

        `arms`: feet from the centre of mass in each step, (N, 4, 3), m; `standing`: which of them stand, (N, 4).
        """
        steps, legs = standing.shape
        moments = self.moments(body.inertia, arms).transpose(0, 2, 1, 3).reshape(steps, 3, 3 * legs)
        forces = np.tile(np.eye(3) / body.mass, (1, legs))
        free = self.free(body)
        turned = weights.angles[:, None, None] * self._place_square + weights.turning[:, None, None] * self._rate_square
        moved = (
            weights.position[:, None, None] * self._place_square + weights.velocity[:, None, None] * self._rate_square
        )
        size = steps * 3 * legs
        weighted = np.einsum("jax,ajl->jxal", moments, turned)
        hessian = np.einsum("jxal,lay->jxly", weighted, moments)
        hessian += np.einsum("ax,ajl,ay->jxly", forces, moved, forces, optimize=True)
        angular = self.place.T @ (weights.angles * (free.angles - wanted.angles)) + self.rate.T @ (
            weights.turning * (free.turning - wanted.turning)
        )
        linear = self.place.T @ (weights.position * (free.position - wanted.position)) + self.rate.T @ (
            weights.velocity * (free.velocity - wanted.velocity)
        )
        gradient = np.einsum("jax,ja->jx", moments, angular) + linear @ forces
        kept = np.repeat(standing.reshape(-1), 3)
        dense = hessian.reshape(size, size)[np.ix_(kept, kept)]
        dense[np.diag_indices_from(dense)] += weights.force
        rows, lower, upper = friction_rows(int(standing.sum()), friction)
        return Program(dense, gradient.reshape(size)[kept], rows, lower, upper)

    def spread(self, solution: Floats, standing: Bools) -> Floats:
        """Forces of every foot in every step, (N, 4, 3), N, zero where it does not stand."""
        forces = np.zeros((*standing.shape, 3))
        forces[standing] = solution.reshape(-1, 3)
        return forces

    def predicted(self, body: Body, arms: Floats, forces: Floats) -> Reference:
        """Where the body goes under these forces, (N, 4, 3), N."""
        free = self.free(body)
        linear = forces.sum(axis=1) / body.mass
        angular = np.einsum("jlax,jlx->ja", self.moments(body.inertia, arms), forces)
        return Reference(
            free.angles + self.place @ angular,
            free.position + self.place @ linear,
            free.turning + self.rate @ angular,
            free.velocity + self.rate @ linear,
        )


def friction_rows(feet: int, friction: Friction) -> tuple[Floats, Floats, Floats]:
    """Rows of the forces of so many feet, (5 feet, 3 feet), with their bounds: a pyramid, and the vertical force."""
    share = friction.share
    one = np.array([[1, 0, -share], [-1, 0, -share], [0, 1, -share], [0, -1, -share], [0, 0, 1.0]])
    lower = np.array([-np.inf] * 4 + [friction.least])
    upper = np.array([0.0] * 4 + [friction.most])
    return np.kron(np.eye(feet), one), np.tile(lower, feet), np.tile(upper, feet)
