"""Smooth transitions of n robots from one gait's parameters and phase offsets to another's."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.gait_cycle import TURN, Floats, smoothstep
from policies.memory import PerRobotState, per_robot

CHANGE_TIME = 1.0
"""Duration of a transition, s."""
_ROUNDING = 1e-9


class GaitTransition(PerRobotState):
    """Interpolates gait parameters, (n, k), and phase offsets, (n, 4), in transitions between gaits.

    Each robot has its own transition. `Gaits` uses one object of this class. No robot is in a transition at the start.

    Args:
        values: Initial parameters, (k,).
        offsets: Initial phase offsets, (4,), rad.
        control_period: Time between two calls of `advance`, s.
    """

    goal: Floats = per_robot()
    """Parameters at the end of the transition, (n, k)."""
    _old: Floats = per_robot()
    _old_offsets: Floats = per_robot()
    _new_offsets: Floats = per_robot()
    _share: Floats = per_robot(1.0)
    """Progress of the transition, 0 to 1, (n,)."""

    def __init__(self, values: Floats, offsets: ArrayLike, control_period: float) -> None:
        self._step = control_period / CHANGE_TIME
        super().__init__(goal=values, _old=values, _old_offsets=offsets, _new_offsets=offsets)

    @property
    def values(self) -> Floats:
        """Current parameters, (n, k)."""
        return self._interpolate(self._old, self.goal)

    @property
    def offsets(self) -> Floats:
        """Current phase offsets, (n, 4), rad; not wrapped to one turn."""
        return self._interpolate(self._old_offsets, self._new_offsets)

    @property
    def settled(self) -> NDArray[np.bool_]:
        """True for robots that are not in a transition, (n,)."""
        return self._share >= 1.0

    def advance(self) -> None:
        """Advance by one control step."""
        self._share = np.minimum(self._share + self._step, 1.0)

    def start(self, mask: NDArray[np.bool_], values: Floats, offsets: Floats) -> None:
        """Start a transition of some robots from their current state.

        Args:
            mask: Robots, (n,).
            values: New parameters, broadcast to (n, k).
            offsets: New phase offsets, broadcast to (n, 4), rad.
        """
        rows = mask[:, None]
        old = self.values
        old_offsets = self.offsets
        # Shift each phase the shorter way round. A shift of half a cycle always goes backward, so that all legs with
        # this shift move in the same direction.
        shift = (offsets - old_offsets + np.pi + _ROUNDING) % TURN - np.pi - _ROUNDING
        self._old = np.where(rows, old, self._old)
        self.goal = np.where(rows, values, self.goal)
        self._old_offsets = np.where(rows, old_offsets, self._old_offsets)
        self._new_offsets = np.where(rows, old_offsets + shift, self._new_offsets)
        self._share = np.where(mask, 0.0, self._share)

    def place(self, mask: NDArray[np.bool_], values: Floats, offsets: Floats) -> None:
        """Set some robots to a gait at once, without a transition.

        Args:
            mask: Robots, (n,).
            values: Parameters, broadcast to (n, k).
            offsets: Phase offsets, broadcast to (n, 4), rad.
        """
        rows = mask[:, None]
        self._old = np.where(rows, values, self._old)
        self.goal = np.where(rows, values, self.goal)
        self._old_offsets = np.where(rows, offsets, self._old_offsets)
        self._new_offsets = np.where(rows, offsets, self._new_offsets)
        self._share = np.where(mask, 1.0, self._share)

    def _interpolate(self, old: Floats, new: Floats) -> Floats:
        """Interpolate between old and new values by the progress of the transition."""
        weight = smoothstep(self._share)[:, None]
        return old + weight * (new - old)
