"""How high the trunk is above the ground that its feet stand on, from where an estimator has the feet.

With g the unit vector of gravity, pᵢ the centre of a foot from the trunk's centre, base frame, and r the depth of the
sole below it, each standing foot gives h = g · pᵢ + r; the height is their mean, weighted by the probability that they
stand. While none stands it goes on by the velocity. Against the ground itself there is nothing to measure it by: where
the trunk hangs over a hollow or a bump it is the height above the feet.
"""

import numpy as np

from quad_env.columns import Array, Rows
from quad_env.robots.robot import Robot
from quad_env.sensing.error_state import FEET, TILT, VELOCITY, BodyMotion, times
from quad_env.sensing.estimator import Height, cross

STANDS = 0.5
"""Probability, summed over the feet, from which the height is known."""


class TrunkHeight:
    """Heights of n robots; `zero`, rad, is the standard deviation of their encoders' zeros."""

    def __init__(self, robot: Robot, num_envs: int, zero: float) -> None:
        self._depth, self._zero = robot.foot_depth, zero
        self._value, self._deviation = np.zeros((2, num_envs))

    @property
    def now(self) -> Height:
        """The heights."""
        return Height(self._value.copy(), self._deviation.copy())

    def begin(self, rows: Rows, motion: BodyMotion, covariance: Array, jacobians: Array) -> None:
        """Start of those robots, on all of their feet."""
        standing = np.ones(motion.feet.shape[:2])
        self._value[rows], self._deviation[rows] = self._by_feet(motion, covariance, standing, jacobians)

    def move_on(
        self, rows: Rows, motion: BodyMotion, covariance: Array, standing: Array, jacobians: Array, dt: float
    ) -> None:
        """One `dt`, s, later.

        `covariance`: of the error of the motion, (k, size, size); `standing`: probabilities, (k, 4); `jacobians`: of
        the feet's places by the leg's own angles, m/rad, (k, 4, 3, 3).
        """
        sinking = (motion.gravity * motion.velocity).sum(axis=-1)
        speed = np.sqrt(_quadratic(motion.gravity, covariance[:, VELOCITY, VELOCITY]))
        value, deviation = self._by_feet(motion, covariance, standing, jacobians)
        known = standing.sum(axis=-1) >= STANDS
        self._value[rows] = np.where(known, value, self._value[rows] - dt * sinking)
        self._deviation[rows] = np.where(known, deviation, self._deviation[rows] + dt * speed)

    def _by_feet(self, motion: BodyMotion, covariance: Array, standing: Array, jacobians: Array) -> tuple[Array, Array]:
        """Height and its standard deviation, m, (k,) each."""
        gravity, weights = motion.gravity, standing / np.maximum(standing.sum(axis=-1), STANDS)[:, None]
        middle = (weights[..., None] * motion.feet).sum(axis=1)
        by_error = np.zeros(covariance.shape[:2])
        by_error[:, TILT] = cross(gravity, middle)
        by_error[:, FEET] = (weights[..., None] * gravity[:, None]).reshape(len(gravity), -1)
        by_zeros = weights[..., None] * times(np.swapaxes(jacobians, -1, -2), gravity[:, None])
        variance = _quadratic(by_error, covariance) + self._zero**2 * (by_zeros * by_zeros).sum(axis=(1, 2))
        return (gravity * middle).sum(axis=-1) + self._depth, np.sqrt(variance)


def _quadratic(vectors: Array, matrices: Array) -> Array:
    """vᵀ M v, (k,)."""
    out: Array = (vectors * times(matrices, vectors)).sum(axis=-1)
    return out
