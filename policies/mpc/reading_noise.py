"""Noise of the readings, estimated from the readings alone.

White noise turns back at once: neighbouring second differences of it have opposite signs, their covariance is -4 σ².
Those of a motion change little from one control step to the next. Autocorrelation gives the variance in adaptive
filters since Mehra, "On the identification of variances and adaptive Kalman filtering", 1970.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain
from quad_env import OBSERVATION

GROUPS = tuple(
    OBSERVATION[name]
    for name in ("projected_gravity", "angular_velocity", "linear_velocity", "joint_position", "joint_velocity")
)
"""Readings of one kind each, which share a noise: (1, rad/s, m/s, rad, rad/s)."""
SENSED = slice(0, GROUPS[-1].stop)
"""Readings in an observation, its first ones."""
NOISE_FLOOR_STD = np.array([0.001, 0.12, 0.025, 0.0015, 0.4])
"""Standard deviations that the readings of each group seem to have in a walk without noise."""
TIME = 0.5
"""Time constant of the estimate, s; at first it is a mean."""
EARLY = 8
"""Looks until which the mean says little: after k of them a quiet walk may seem 1 + 8 / k times as noisy."""
FIRST = 3
"""Looks before there are two second differences."""


class ReadingNoise(PerRobotState):
    """Noise of what n robots are shown, control step by control step of `period` s.

    Args:
        groups: where the k readings of each kind are, m slices, one after the other.
        quiet: standard deviations that these seem to have without noise, (m,).
    """

    sample_count: NDArray[np.int64] = per_robot(0)
    """Readings that each robot has had since its start, (n,)."""
    _last: Floats = per_robot(axis=1)
    _raw_variance: Floats = per_robot()

    def __init__(self, period: float, groups: Sequence[slice] = GROUPS, quiet: Floats = NOISE_FLOOR_STD) -> None:
        self._share, self._groups, self._quiet = lowpass_gain(period, TIME), tuple(groups), quiet
        self._starts, self._sizes = [group.start for group in groups], [group.stop - group.start for group in groups]
        width = max(group.stop for group in groups)
        super().__init__(_last=np.zeros((3, width)), _raw_variance=np.zeros(len(groups)))

    def variances(self, readings: Floats) -> Floats:
        """Of each group, (n, m), after these readings as well, (n, k)."""
        last, before, bend = self._last
        bent = readings - 2.0 * last + before
        product = -0.25 * bent * bend
        seeming = np.add.reduceat(product, self._starts, axis=1) / self._sizes
        self._last = np.array((readings, last, bent))
        self.sample_count += 1
        known = self.sample_count - FIRST
        share = np.where(known > 0, warm_start_gain(self._share, known), 0.0)
        self._raw_variance += share[:, None] * (seeming - self._raw_variance)
        quiet = self._quiet**2 * (1.0 + EARLY / np.maximum(known, 1))[:, None]
        variances: Floats = np.maximum(self._raw_variance - quiet, 0.0)
        return variances
