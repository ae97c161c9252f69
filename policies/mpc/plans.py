"""Force plans of the robots: contact forces over the MPC horizon, and the age of the plans.

A robot applies the forces of its plan until the plan is renewed. The age of the plan gives the present step of the
horizon. If other feet are in stance than planned, the total wrench of the planned forces about the centre of mass is
distributed over the feet in stance.
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.rigid_body import Friction
from quad_env.columns import EnvIndices, EnvSelection, Mask
from quad_env.physics.rotations import cross, skew

_DAMPING = 1e-4
"""Regularisation when a wrench is distributed over the stance feet.

It is needed because two feet cannot give a moment about the line through them."""
_CLOCK_ROUNDING = 1e-6
"""Tolerance for rounding errors of the age of a plan, s."""


class ForcePlans(PerRobotState):
    """Force plans of n robots over a horizon of N steps.

    In the initial plan, every foot carries a quarter of the weight. The initial plan is replaced in the first control
    step, because its age is infinite.

    Args:
        steps: Number of steps N of the horizon.
        period: Duration of a step of the horizon, s.
        weight: Weight of the robot, N.
    """

    forces: Floats = per_robot()
    """Planned contact force of each foot in each of the N steps, level frame, (n, N, 4, 3), N."""
    age: Floats = per_robot(np.inf)
    """Time since the plan was computed, (n,), s; infinite before the first plan."""
    _stance: Mask = per_robot()
    """True for the planned stance feet in each step, (n, N, 4)."""
    _moment_arms: Floats = per_robot()
    """Planned vectors from the centre of mass to the feet in each step, level frame, (n, N, 4, 3), m."""

    def __init__(self, steps: int, period: float, weight: float) -> None:
        self._steps = steps
        self._period = period
        super().__init__(
            forces=np.tile([0.0, 0.0, 0.25 * weight], (steps, 4, 1)),
            _stance=np.ones((steps, 4), np.bool_),
            _moment_arms=np.zeros((steps, 4, 3)),
        )

    def advance(self, time: float) -> None:
        """Add `time`, s, to the age of every plan."""
        self.age += time

    def due(self, stance: Mask, interval: float) -> Mask:
        """Return the mask of robots that need a new plan.

        A robot needs a new plan if its plan is old, or if other feet are in stance than planned.

        Args:
            stance: Present stance feet, (n, 4).
            interval: Age from which a plan is old, s.

        Returns:
            True for robots that need a new plan, (n,).
        """
        is_old = self.age > interval - _CLOCK_ROUNDING
        if is_old.all():
            return is_old
        has_other_stance: Mask = (self._stance[self._robots, self._step] != stance).any(axis=1)
        return has_other_stance | is_old

    def renew(self, robots: EnvSelection, forces: Floats, stance: Mask, moment_arms: Floats) -> None:
        """Replace the plans of g robots by new plans that start now; their age is set to zero.

        Args:
            robots: Indices of the robots, (g,).
            forces: Contact forces in each step, level frame, (g, N, 4, 3), N.
            stance: True for the stance feet in each step, (g, N, 4).
            moment_arms: Vectors from the centre of mass to the feet in each step, level frame, (g, N, 4, 3), m.
        """
        self.forces[robots] = forces
        self._stance[robots] = stance
        self._moment_arms[robots] = moment_arms
        self.age[robots] = 0.0

    def present_forces(self, stance: Mask, moment_arms: Floats, friction: Friction) -> Floats:
        """Return the contact forces of the present step of each plan.

        If other feet are in stance than planned, the total wrench of the planned forces is distributed over them.

        Args:
            stance: Present stance feet, (n, 4).
            moment_arms: Present vectors from the centre of mass to the feet, level frame, (n, 4, 3), m.
            friction: Bounds of the contact forces; used only if a wrench is distributed.

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
        """Index of the present step of each robot's plan, (n,); N - 1 if the plan is older than the horizon."""
        return np.minimum((self.age + _CLOCK_ROUNDING) / self._period, self._steps - 1).astype(np.intp)


def distribute_wrench(wrench: Floats, stance: Mask, moment_arms: Floats, friction: Friction) -> Floats:
    """Distribute a wrench over the stance feet.

    The result is the contact forces with the smallest norm that give the wrench. The forces are clipped to the friction
    pyramid afterwards, so that their sum may differ from the wrench.

    Args:
        wrench: Total force, N, and moment about the centre of mass, N·m, level frame, (n, 6).
        stance: Stance feet, (n, 4).
        moment_arms: Vectors from the centre of mass to the feet, level frame, (n, 4, 3), m.
        friction: Bounds of the contact forces.

    Returns:
        Contact forces, level frame, (n, 4, 3), N; zero for feet that are not in stance.
    """
    effects = np.concatenate((np.broadcast_to(np.eye(3), (len(moment_arms), 4, 3, 3)), skew(moment_arms)), axis=2)
    forces = min_norm_forces(effects, wrench, stance, _DAMPING)
    normal = np.clip(forces[..., 2], 0.0, friction.max_normal_force[:, None])
    max_tangential = friction.coefficient[:, None, None] * normal[..., None]
    tangential = np.clip(forces[..., :2], -max_tangential, max_tangential)
    clipped = np.concatenate((tangential, normal[..., None]), axis=-1)
    return np.where(stance[..., None], clipped, 0.0)


def min_norm_forces(effects: Floats, wanted: Floats, stance: Mask, damping: float) -> Floats:
    """Return the stance forces with the smallest norm that give a desired effect, such as a wrench.

    They are the damped least-squares solution f = Eᵀ (E Eᵀ + λ 1)⁻¹ w.

    Args:
        effects: Matrix E of each foot, from its force to the effect of the force, (n, 4, 6, 3).
        wanted: Desired sum w of the effects of all stance feet, (n, 6).
        stance: Stance feet, (n, 4).
        damping: Damping λ, which keeps the forces finite for effects that the feet cannot have.

    Returns:
        Forces, (n, 4, 3); zero for feet that are not in stance.
    """
    matrix = np.where(stance[..., None, None], effects, 0.0).transpose(0, 2, 1, 3).reshape(len(wanted), 6, 12)
    square = np.matmul(matrix, matrix.transpose(0, 2, 1)) + damping * np.eye(6)
    multipliers = np.linalg.solve(square, wanted[..., None])
    forces: Floats = np.matmul(matrix.transpose(0, 2, 1), multipliers).reshape(*stance.shape, 3)
    return forces
