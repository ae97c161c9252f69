"""The way of n robots from one gait's numbers and phase offsets to another's, each robot at its own time."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.gait_cycle import TURN, Floats, smoothstep
from policies.memory import PerRobotState, per_robot

CHANGE_TIME = 1.0
"""From one gait to another, s."""
_ROUNDING = 1e-9


class GaitTransition(PerRobotState):
    """Values (n, k) and phase offsets (n, 4), rad, that go smoothly from old ones to new ones; all start settled at
    `values`, (k,), and `offsets`, (4,)."""

    goal: Floats = per_robot()
    """The values that the robots are sent to, (n, k)."""
    _old: Floats = per_robot()
    _old_offsets: Floats = per_robot()
    _new_offsets: Floats = per_robot()
    _share: Floats = per_robot(1.0)

    def __init__(self, values: Floats, offsets: ArrayLike, control_period: float) -> None:
        self._step = control_period / CHANGE_TIME
        super().__init__(goal=values, _old=values, _old_offsets=offsets, _new_offsets=offsets)

    @property
    def values(self) -> Floats:
        """The values now, (n, k)."""
        return self._between(self._old, self.goal)

    @property
    def offsets(self) -> Floats:
        """The phase offsets now, rad, (n, 4); not wrapped."""
        return self._between(self._old_offsets, self._new_offsets)

    @property
    def settled(self) -> NDArray[np.bool_]:
        """Which robots are at the new values, (n,)."""
        return self._share >= 1.0

    def advance(self) -> None:
        """Go on by one control step."""
        self._share = np.minimum(self._share + self._step, 1.0)

    def start(self, mask: NDArray[np.bool_], values: Floats, offsets: Floats) -> None:
        """Send the masked robots (n,) from where they are to these values and offsets, of shapes to broadcast."""
        rows = mask[:, None]
        old, old_offsets = self.values, self.offsets
        # The shorter way round; half a cycle always backward, so that all legs that shift by it go together.
        ahead = (offsets - old_offsets + np.pi + _ROUNDING) % TURN - np.pi - _ROUNDING
        self._old, self.goal = np.where(rows, old, self._old), np.where(rows, values, self.goal)
        self._old_offsets = np.where(rows, old_offsets, self._old_offsets)
        self._new_offsets = np.where(rows, old_offsets + ahead, self._new_offsets)
        self._share = np.where(mask, 0.0, self._share)

    def place(self, mask: NDArray[np.bool_], values: Floats, offsets: Floats) -> None:
        """Put the masked robots (n,) at these values and offsets, settled; of shapes to broadcast."""
        rows = mask[:, None]
        self._old, self.goal = np.where(rows, values, self._old), np.where(rows, values, self.goal)
        self._old_offsets = np.where(rows, offsets, self._old_offsets)
        self._new_offsets = np.where(rows, offsets, self._new_offsets)
        self._share = np.where(mask, 1.0, self._share)

    def _between(self, old: Floats, new: Floats) -> Floats:
        weight = smoothstep(self._share)[:, None]
        return old + weight * (new - old)
