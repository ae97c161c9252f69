"""How noisy readings are, told from the readings alone.

White noise turns back at once: neighbouring second differences of it have opposite signs, their covariance is -4 σ².
Those of a motion change little from one control step to the next. Autocorrelation tells the variance in adaptive
filters since Mehra, "On the identification of variances and adaptive Kalman filtering", 1970.
"""

import numpy as np
from numpy.typing import NDArray

from policies.gait import Floats
from policies.legs.memory import taken_in
from quad_env import OBSERVATION

GROUPS = tuple(
    OBSERVATION[name]
    for name in ("projected_gravity", "angular_velocity", "linear_velocity", "joint_position", "joint_velocity")
)
"""Readings of one kind each, which share a noise: (1, rad/s, m/s, rad, rad/s)."""
SENSED = GROUPS[-1].stop
"""Readings in an observation, its first ones."""
QUIET = np.array([0.001, 0.12, 0.025, 0.0015, 0.4])
"""Standard deviations that the readings of each group seem to have in a walk without noise."""
TIME = 0.5
"""Time constant of the estimate, s; at first it is a mean."""
EARLY = 8
"""Looks until which the mean says little: after k of them a quiet walk may seem 1 + 8 / k times as noisy."""
FIRST = 3
"""Looks before there are two second differences."""


class ReadingNoise:
    """Noise of what n robots are shown, control step by control step of `period` s."""

    def __init__(self, period: float) -> None:
        self._share = taken_in(period, TIME)
        self.allocate(1)

    def allocate(self, num_envs: int) -> None:
        """Fresh state for so many robots."""
        self._looks = np.zeros(num_envs, np.int64)
        self._last = np.zeros((3, num_envs, SENSED))
        self._seeming = np.zeros((num_envs, len(GROUPS)))

    def restart(self, mask: NDArray[np.bool_]) -> None:
        """Fresh state for those robots."""
        self._looks[mask], self._seeming[mask] = 0, 0.0

    def variances(self, readings: Floats) -> Floats:
        """Of each group, (n, 5), after these readings as well, (n, 33)."""
        last, before, bend = self._last
        bent = readings - 2.0 * last + before
        product = -0.25 * bent * bend
        seeming = np.stack([product[:, group].mean(axis=1) for group in GROUPS], axis=-1)
        share = np.maximum(self._share, 1.0 / np.maximum(self._looks - FIRST + 1, 1))
        self._seeming += np.where(self._looks >= FIRST, share, 0.0)[:, None] * (seeming - self._seeming)
        self._last = np.stack((readings, last, bent))
        self._looks += 1
        quiet = QUIET**2 * (1.0 + EARLY / np.maximum(self._looks - FIRST, 1))[:, None]
        variances: Floats = np.maximum(self._seeming - quiet, 0.0)
        return variances
