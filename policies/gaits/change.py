"""Smooth transitions of n robots between gaits: interpolation of gait parameters and phase offsets."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.gait_cycle import TURN, Floats, smoothstep
from policies.memory import PerRobotState, per_robot

CHANGE_TIME = 1.0
"""Duration of a transition from one gait to another, s."""
_ROUNDING = 1e-9
"""Tolerance for rounding errors when a phase offset changes by exactly half a cycle, rad."""


class GaitTransition(PerRobotState):
    """Transitions of n robots between gaits: interpolated gait parameters and phase offsets of the legs.

    Each robot has its own transition, which lasts CHANGE_TIME. Initially no robot is in a transition. The policy
    `Gaits` uses one object of this class.

    Args:
        values: The k parameters of the initial gait as an array, (k,).
        offsets: Phase offsets of the legs from the gait clock in the initial gait, (4,), rad.
        control_period: Time between two calls of `advance`, s.
    """

    goal: Floats = per_robot()
    """The k gait parameters of each robot at the end of its transition, (n, k)."""
    _old: Floats = per_robot()
    """The k gait parameters of each robot at the start of its transition, (n, k)."""
    _old_offsets: Floats = per_robot()
    """Phase offset of each leg from the gait clock at the start of the transition, (n, 4), rad."""
    _new_offsets: Floats = per_robot()
    """Phase offset of each leg from the gait clock at the end of the transition, (n, 4), rad."""
    _share: Floats = per_robot(1.0)
    """Elapsed fraction of the transition of each robot, 0 to 1, (n,); 1 for robots that are not in a transition."""

    def __init__(self, values: Floats, offsets: ArrayLike, control_period: float) -> None:
        self._step = control_period / CHANGE_TIME
        super().__init__(goal=values, _old=values, _old_offsets=offsets, _new_offsets=offsets)

    @property
    def values(self) -> Floats:
        """The k current gait parameters of each robot, (n, k); interpolated while a robot is in a transition."""
        return self._interpolate(self._old, self.goal)

    @property
    def offsets(self) -> Floats:
        """Current phase offset of each leg from the gait clock, (n, 4), rad; it may lie outside of [0, 2π)."""
        return self._interpolate(self._old_offsets, self._new_offsets)

    @property
    def settled(self) -> NDArray[np.bool_]:
        """True for robots that are not in a transition between gaits, (n,)."""
        return self._share >= 1.0

    def advance(self) -> None:
        """Advance the transitions of all robots by one control step."""
        self._share = np.minimum(self._share + self._step, 1.0)

    def start(self, mask: NDArray[np.bool_], values: Floats, offsets: Floats) -> None:
        """Start the transition of some robots from their current parameters and offsets to a new gait.

        Args:
            mask: True for robots that change their gait, (n,).
            values: The k parameters of the new gait, (k,) or (n, k).
            offsets: Phase offsets of the legs in the new gait, broadcast to (n, 4), rad.
        """
        rows = mask[:, None]
        old = self.values
        old_offsets = self.offsets
        # Each phase offset changes by at most half a cycle. A change by exactly half a cycle always goes backward,
        # because all legs with this change must move in the same direction.
        shift = (offsets - old_offsets + np.pi + _ROUNDING) % TURN - np.pi - _ROUNDING
        self._old = np.where(rows, old, self._old)
        self.goal = np.where(rows, values, self.goal)
        self._old_offsets = np.where(rows, old_offsets, self._old_offsets)
        self._new_offsets = np.where(rows, old_offsets + shift, self._new_offsets)
        self._share = np.where(mask, 0.0, self._share)

    def place(self, mask: NDArray[np.bool_], values: Floats, offsets: Floats) -> None:
        """Set the gait parameters and phase offsets of some robots to a gait immediately, with no transition.

        Args:
            mask: True for robots that are set to the gait, (n,).
            values: The k parameters of the gait, (k,) or (n, k).
            offsets: Phase offsets of the legs in the gait, broadcast to (n, 4), rad.
        """
        rows = mask[:, None]
        self._old = np.where(rows, values, self._old)
        self.goal = np.where(rows, values, self.goal)
        self._old_offsets = np.where(rows, offsets, self._old_offsets)
        self._new_offsets = np.where(rows, offsets, self._new_offsets)
        self._share = np.where(mask, 1.0, self._share)

    def _interpolate(self, old: Floats, new: Floats) -> Floats:
        """Interpolate smoothly from `old` to `new` values over the elapsed fraction of each transition.

        Both arguments and the result have the shape (n, k), with k numbers per robot.
        """
        weight = smoothstep(self._share)[:, None]
        return old + weight * (new - old)
