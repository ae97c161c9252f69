"""Force plans of the robots: contact forces over the horizon, and their age.

A robot follows its plan until the plan is renewed; the age of the plan selects the step. If other feet are in stance
than planned, the wrench of the planned forces about the centre of mass is distributed over the feet in stance.
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.rigid_body import Friction
from quad_env.columns import EnvIndices, EnvSelection, Mask
from quad_env.physics.rotations import cross, skew

_DAMPING = 1e-4
"""Regularisation of the distribution of a wrench: two feet cannot give a moment about the line through them."""
_CLOCK_ROUNDING = 1e-6
"""Tolerance for the rounding of the age of a plan, s."""


class ForcePlans(PerRobotState):
    """Force plans of n robots for N steps.

    In the initial plan every foot carries a quarter of the weight. The initial plan is due for renewal at once.

    Args:
        steps: Number of steps N.
        period: Duration of a step, s.
        weight: Weight of the robot, N.
    """

    forces: Floats = per_robot()
    """Planned contact forces, level frame, (n, N, 4, 3), N."""
    age: Floats = per_robot(np.inf)
    """Time since the forces were planned, (n,), s."""
    _stance: Mask = per_robot()
    """Stance feet of the plan, (n, N, 4)."""
    _moment_arms: Floats = per_robot()
    """Planned vectors from the centre of mass to the feet, (n, N, 4, 3), m."""

    def __init__(self, steps: int, period: float, weight: float) -> None:
        self._steps = steps
        self._period = period
        super().__init__(
            forces=np.tile([0.0, 0.0, 0.25 * weight], (steps, 4, 1)),
            _stance=np.ones((steps, 4), np.bool_),
            _moment_arms=np.zeros((steps, 4, 3)),
        )

    def advance(self, time: float) -> None:
        """Advance the age of the plans by `time`, s."""
        self.age += time

    def due(self, stance: Mask, interval: float) -> Mask:
        """Return True for robots that need a new plan.

        Args:
            stance: Present stance feet, (n, 4). A plan for other stance feet is due.
            interval: Age from which a plan is due, s.

        Returns:
            Mask, (n,) bool.
        """
        is_old = self.age > interval - _CLOCK_ROUNDING
        if is_old.all():
            return is_old
        has_other_stance: Mask = (self._stance[self._robots, self._step] != stance).any(axis=1)
        return has_other_stance | is_old

    def renew(self, robots: EnvSelection, forces: Floats, stance: Mask, moment_arms: Floats) -> None:
        """Replace the plans of g robots by new plans that start now.

        Args:
            robots: Indices of the robots, (g,).
            forces: Contact forces, level frame, (g, N, 4, 3), N.
            stance: Stance feet, (g, N, 4).
            moment_arms: Vectors from the centre of mass to the feet, level frame, (g, N, 4, 3), m.
        """
        self.forces[robots] = forces
        self._stance[robots] = stance
        self._moment_arms[robots] = moment_arms
        self.age[robots] = 0.0

    def present_forces(self, stance: Mask, moment_arms: Floats, friction: Friction) -> Floats:
        """Return the contact forces of the present step of each plan.

        Args:
            stance: Present stance feet, (n, 4).
            moment_arms: Present vectors from the centre of mass to the feet, level frame, (n, 4, 3), m.
            friction: Bounds of the forces; used only if other feet are in stance than planned.

        Returns:
            Contact forces, level frame, (n, 4, 3), N.
        """
        robots = self._robots
        step = self._step
        forces: Floats = self.forces[robots, step]
        as_planned = (self._stance[robots, step] == stance).all(axis=1)
        if as_planned.all():
            return forces
        moment = cross(self._moment_arms[robots, step], forces).sum(axis=1)
        wrench = np.concatenate((forces.sum(axis=1), moment), axis=1)
        return np.where(as_planned[:, None, None], forces, distribute_wrench(wrench, stance, moment_arms, friction))

    @property
    def _robots(self) -> EnvIndices:
        """Indices of all robots, (n,)."""
        return np.arange(len(self.age))

    @property
    def _step(self) -> EnvIndices:
        """Index of the present step of each plan, (n,); the last index after the end of the horizon."""
        return np.minimum((self.age + _CLOCK_ROUNDING) / self._period, self._steps - 1).astype(np.intp)


def distribute_wrench(wrench: Floats, stance: Mask, moment_arms: Floats, friction: Friction) -> Floats:
    """Distribute a wrench over the stance feet.

    Args:
        wrench: Wrench about the centre of mass, (n, 6), N and N·m.
        stance: Stance feet, (n, 4).
        moment_arms: Vectors from the centre of mass to the feet, (n, 4, 3), m.
        friction: Bounds of the forces.

    Returns:
        Minimum-norm contact forces clipped to the friction pyramid, (n, 4, 3), N. The clipped forces may not sum to
        the wrench.
    """
    effects = np.concatenate((np.broadcast_to(np.eye(3), (len(moment_arms), 4, 3, 3)), skew(moment_arms)), axis=2)
    forces = min_norm_forces(effects, wrench, stance, _DAMPING)
    normal = np.clip(forces[..., 2], 0.0, friction.max_normal_force[:, None])
    max_tangential = friction.coefficient[:, None, None] * normal[..., None]
    tangential = np.clip(forces[..., :2], -max_tangential, max_tangential)
    clipped = np.concatenate((tangential, normal[..., None]), axis=-1)
    return np.where(stance[..., None], clipped, 0.0)


def min_norm_forces(effects: Floats, wanted: Floats, stance: Mask, damping: float) -> Floats:
    """Return the smallest stance forces with a wanted effect: f = Eᵀ (E Eᵀ + damping)⁻¹ wanted.

    Args:
        effects: Matrix E from the force on each foot to its effect, (n, 4, 6, 3).
        wanted: Wanted effect, (n, 6).
        stance: Stance feet, (n, 4).
        damping: Regularisation for effects that the feet cannot have.

    Returns:
        Forces, (n, 4, 3).
    """
    matrix = np.where(stance[..., None, None], effects, 0.0).transpose(0, 2, 1, 3).reshape(len(wanted), 6, 12)
    square = np.matmul(matrix, matrix.transpose(0, 2, 1)) + damping * np.eye(6)
    multipliers = np.linalg.solve(square, wanted[..., None])
    forces: Floats = np.matmul(matrix.transpose(0, 2, 1), multipliers).reshape(*stance.shape, 3)
    return forces
