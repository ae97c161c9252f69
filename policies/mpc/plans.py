"""Plans in force: forces of the feet over the horizon, each as old as the time since it was found.

A plan that is not renewed goes on where it was left: at its age. It says which feet were to stand then; where others
do, those share the wrench that the planned forces have about the centre of mass.
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.rigid_body import Friction
from quad_env.columns import EnvIndices, EnvSelection, Mask
from quad_env.physics.rotations import cross, skew

_DAMPING = 1e-4
"""Added to the squared arms, m², and to the number of feet: two feet bear no moment about their line."""
_TICK = 1e-6
"""Rounding of a clock, s."""


class ForcePlans(PerRobotState):
    """Plans of n robots for N steps of `period` s; at first every foot bears a quarter of `weight`, N, for ever."""

    forces: Floats = per_robot()
    """Level frame, N."""
    age: Floats = per_robot(np.inf)
    """Time since the forces were found, (n,), s."""
    _stance: Mask = per_robot()
    _moment_arms: Floats = per_robot()

    def __init__(self, steps: int, period: float, weight: float) -> None:
        self._steps = steps
        self._period = period
        super().__init__(
            forces=np.tile([0.0, 0.0, 0.25 * weight], (steps, 4, 1)),
            _stands=np.ones((steps, 4), np.bool_),
            _arms=np.zeros((steps, 4, 3)),
        )

    def advance(self, time: float) -> None:
        """So many s have passed."""
        self.age += time

    def due(self, stance: Mask, interval: float) -> Mask:
        """Which robots need another plan, (n,): after `interval` s, or where other feet stand than was planned."""
        if (old := self.age > interval - _TICK).all():
            return old
        others: Mask = (self._stance[self._robots, self._step] != stance).any(axis=1)
        return others | old

    def renew(self, robots: EnvSelection, forces: Floats, stands: Mask, arms: Floats) -> None:
        """Plans from now on of g robots: forces (g, N, 4, 3), which feet stand, (g, N, 4), and the feet from the centre
        of mass, (g, N, 4, 3), m."""
        self.forces[robots], self._stance[robots], self._moment_arms[robots], self.age[robots] = (
            forces,
            stands,
            arms,
            0.0,
        )

    def present_forces(self, stance: Mask, arms: Floats, friction: Friction) -> Floats:
        """Forces of the feet now, (n, 4, 3), N. `arms`: of the feet from the centre of mass, (n, 4, 3), m."""
        robots, step = self._robots, self._step
        forces: Floats = self.forces[robots, step]
        as_planned = (self._stance[robots, step] == stance).all(axis=1)
        if as_planned.all():
            return forces
        moment = cross(self._moment_arms[robots, step], forces).sum(axis=1)
        wrench = np.concatenate((forces.sum(axis=1), moment), axis=1)
        return np.where(as_planned[:, None, None], forces, distribute_wrench(wrench, stance, arms, friction))

    @property
    def _robots(self) -> EnvIndices:
        return np.arange(len(self.age))

    @property
    def _step(self) -> EnvIndices:
        """Step of its plan that each robot is in, the last one afterwards, (n,)."""
        return np.minimum((self.age + _TICK) / self._period, self._steps - 1).astype(np.intp)


def distribute_wrench(wrench: Floats, stance: Mask, arms: Floats, friction: Friction) -> Floats:
    """The smallest forces of the stance feet, (n, 4, 3), N, that together have that wrench about the centre of mass,
    (n, 6), N and N·m, as near as may be; then drawn into the friction's bounds."""
    effects = np.concatenate((np.broadcast_to(np.eye(3), (len(arms), 4, 3, 3)), skew(arms)), axis=2)
    forces = min_norm_forces(effects, wrench, stance, _DAMPING)
    up = np.clip(forces[..., 2], 0.0, friction.max_normal_force[:, None])
    across = friction.coefficient[:, None, None] * up[..., None]
    drawn = np.concatenate((np.clip(forces[..., :2], -across, across), up[..., None]), axis=-1)
    return np.where(stance[..., None], drawn, 0.0)


def min_norm_forces(effects: Floats, wanted: Floats, stance: Mask, least: float) -> Floats:
    """The smallest forces of the stance feet, (n, 4, 3), that together do what is wanted, (n, 6), as near as may be.

    `effects`: of each force, (n, 4, 6, 3); `least`: added to their squares, for what the feet cannot do.
    """
    per_force = np.where(stance[..., None, None], effects, 0.0).transpose(0, 2, 1, 3).reshape(len(wanted), 6, 12)
    square = np.matmul(per_force, per_force.transpose(0, 2, 1)) + least * np.eye(6)
    share = np.linalg.solve(square, wanted[..., None])
    forces: Floats = np.matmul(per_force.transpose(0, 2, 1), share).reshape(*stance.shape, 3)
    return forces
