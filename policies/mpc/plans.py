"""Force plans of the robots: contact forces over the prediction horizon of the MPC, and the age of each plan.

A robot applies the forces of its plan until the plan is replaced by a new one. The age of the plan gives the present
step of the horizon. If other feet are in stance than planned, the wrench of the planned forces about the centre of mass
is distributed over the actual stance feet.
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.rigid_body import Friction
from quad_env.columns import EnvIndices, EnvSelection, Mask
from quad_env.physics.rotations import cross, skew

_DAMPING = 1e-4
"""Damping of the least-squares solution that distributes a wrench over the stance feet.

Damping is needed because two feet cannot exert a moment about the line through these feet."""
_CLOCK_ROUNDING = 1e-6
"""Tolerance for rounding errors of the age of a force plan, s."""


class ForcePlans(PerRobotState):
    """Force plans of n robots: planned contact forces over a horizon of N steps.

    In the initial plan, every foot carries a quarter of the weight. The initial plan is replaced in the first control
    step, because its age is infinite.

    Args:
        steps: Number of steps N of the prediction horizon.
        period: Duration of a step of the prediction horizon, s.
        weight: Weight of the robot, N.
    """

    forces: Floats = per_robot()
    """Planned contact force of each foot in each of the N steps of the horizon, level frame, (n, N, 4, 3), N.

    The level frame turns only with the yaw of the robot, and its z axis points up.
    """
    age: Floats = per_robot(np.inf)
    """Time since the force plan of each robot was computed, (n,), s; infinite before the first plan."""
    _stance: Mask = per_robot()
    """True for feet that are planned to be in stance, for each of the N steps of the horizon, (n, N, 4)."""
    _moment_arms: Floats = per_robot()
    """Planned vectors from the centre of mass to the feet in each of the N steps, level frame, (n, N, 4, 3), m.

    The level frame turns only with the yaw of the robot, and its z axis points up.
    """

    def __init__(self, steps: int, period: float, weight: float) -> None:
        self._steps = steps
        self._period = period
        super().__init__(
            forces=np.tile([0.0, 0.0, 0.25 * weight], (steps, 4, 1)),
            _stance=np.ones((steps, 4), np.bool_),
            _moment_arms=np.zeros((steps, 4, 3)),
        )

    def advance(self, time: float) -> None:
        """Add the elapsed `time`, s, to the age of every force plan."""
        self.age += time

    def due(self, stance: Mask, interval: float) -> Mask:
        """Return the mask of robots that need a new force plan.

        A robot needs a new plan if its plan has reached the age `interval`, or if other feet are in stance than
        planned.

        Args:
            stance: True for feet that are in stance now, (n, 4).
            interval: Age at which a plan is replaced, s.

        Returns:
            True for robots that need a new force plan, (n,).
        """
        is_old = self.age > interval - _CLOCK_ROUNDING
        if is_old.all():
            return is_old
        has_other_stance: Mask = (self._stance[self._robots, self._step] != stance).any(axis=1)
        return has_other_stance | is_old

    def renew(self, robots: EnvSelection, forces: Floats, stance: Mask, moment_arms: Floats) -> None:
        """Replace the force plans of g robots by new plans that start now; their age is zero.

        Args:
            robots: Indices of the robots, (g,).
            forces: Contact forces in each of the N steps of the horizon, level frame (yaw only), (g, N, 4, 3), N.
            stance: True for the stance feet in each step of the horizon, (g, N, 4).
            moment_arms: Vectors from the centre of mass to the feet in each step of the horizon, level frame, (g, N, 4,
                3), m.
        """
        self.forces[robots] = forces
        self._stance[robots] = stance
        self._moment_arms[robots] = moment_arms
        self.age[robots] = 0.0

    def present_forces(self, stance: Mask, moment_arms: Floats, friction: Friction) -> Floats:
        """Return the contact forces that each force plan gives for the present step of its horizon.

        If other feet are in stance than planned, the total wrench of the planned forces is distributed over the feet
        that are in stance.

        Args:
            stance: True for feet that are in stance now, (n, 4).
            moment_arms: Present vectors from the centre of mass to the feet, level frame (yaw only), (n, 4, 3), m.
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
        """Indices 0 to n - 1 of all robots, (n,)."""
        return np.arange(len(self.age))

    @property
    def _step(self) -> EnvIndices:
        """Index of the present horizon step in each robot's plan, (n,); N - 1 if the plan is older than the horizon."""
        return np.minimum((self.age + _CLOCK_ROUNDING) / self._period, self._steps - 1).astype(np.intp)


def distribute_wrench(wrench: Floats, stance: Mask, moment_arms: Floats, friction: Friction) -> Floats:
    """Distribute a wrench (force and moment) over the stance feet.

    The contact forces with the smallest norm that give the wrench are computed first. These forces are then clipped to
    the friction pyramid. The wrench of the clipped forces may therefore differ from the given wrench.

    Args:
        wrench: Wrench on each robot, level frame (yaw only), (n, 6): force, N, then moment about the centre of mass,
            N·m.
        stance: True for stance feet, (n, 4).
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
    """Return the forces on the stance feet with the smallest norm that give a desired effect, such as a wrench.

    The effect is linear in the forces. The forces are the damped least-squares solution f = Eᵀ (E Eᵀ + λ 1)⁻¹ w. E is
    the matrix from the forces on all stance feet to their total effect.

    Args:
        effects: Block of the matrix E for each foot, from the force on the foot to its effect, (n, 4, 6, 3).
        wanted: Desired sum w of the effects of all stance feet, (n, 6).
        stance: True for stance feet, (n, 4).
        damping: Damping λ, which keeps the forces finite if the feet cannot give the desired effect.

    Returns:
        Forces on the feet, (n, 4, 3); zero for feet that are not in stance.
    """
    matrix = np.where(stance[..., None, None], effects, 0.0).transpose(0, 2, 1, 3).reshape(len(wanted), 6, 12)
    square = np.matmul(matrix, matrix.transpose(0, 2, 1)) + damping * np.eye(6)
    multipliers = np.linalg.solve(square, wanted[..., None])
    forces: Floats = np.matmul(matrix.transpose(0, 2, 1), multipliers).reshape(*stance.shape, 3)
    return forces
