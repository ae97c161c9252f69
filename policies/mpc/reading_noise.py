"""Noise of the readings, estimated from the readings alone.

Two consecutive second differences of white noise have opposite signs, and their covariance is -4 σ². The second
differences of a motion change little from one control step to the next. The method, noise variance from
autocorrelation, is by Mehra, "On the identification of variances and adaptive Kalman filtering", 1970.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain
from policies.mpc.readings import GROUPS

NOISE_FLOOR_STD = np.array([0.001, 0.12, 0.025, 0.0015, 0.4])
"""Standard deviation that the estimator shows for each group in a walk although the readings have no noise.

Unit vector, rad/s, m/s, rad, rad/s."""
FILTER_TIME = 0.5
"""Time constant of the variance estimate, s. Before this time has passed, the estimate is a running mean."""
EARLY_SAMPLES = 8
"""The noise floor is multiplied by 1 + EARLY_SAMPLES / k after k samples, because few samples scatter."""
SAMPLES_WITHOUT_ESTIMATE = 3
"""Number of samples before two second differences are available."""


class NoiseEstimator(PerRobotState):
    """Estimates the noise variance of the readings of n robots, per group.

    Args:
        period: Control period, s.
        groups: Slices of the m groups of readings, adjacent and in order. A group has readings of one kind.
        noise_floor_std: Standard deviation that the estimator shows for each group if its noise is zero, (m,).
    """

    sample_count: NDArray[np.int64] = per_robot(0)
    """Readings of each robot since its reset, (n,)."""
    _last: Floats = per_robot(axis=1)
    """Readings one and two samples ago, and the last second difference, (3, n, k)."""
    _raw_variance: Floats = per_robot()
    """Variance before the noise floor is subtracted, (n, m)."""

    def __init__(
        self, period: float, groups: Sequence[slice] = GROUPS, noise_floor_std: Floats = NOISE_FLOOR_STD
    ) -> None:
        self._gain = lowpass_gain(period, FILTER_TIME)
        self._noise_floor_std = noise_floor_std
        self._starts = [group.start for group in groups]
        self._sizes = [group.stop - group.start for group in groups]
        width = max(group.stop for group in groups)
        super().__init__(_last=np.zeros((3, width)), _raw_variance=np.zeros(len(groups)))

    def update(self, readings: Floats) -> Floats:
        """Update with readings, (n, k), and return the noise variance of each group, (n, m).

        A variance below the noise floor is returned as zero.
        """
        last, second_last, last_difference = self._last
        difference = readings - 2.0 * last + second_last
        product = -0.25 * difference * last_difference
        sample_variance = np.add.reduceat(product, self._starts, axis=1) / self._sizes
        self._last = np.array((readings, last, difference))
        self.sample_count += 1
        estimate_count = self.sample_count - SAMPLES_WITHOUT_ESTIMATE
        gain = np.where(estimate_count > 0, warm_start_gain(self._gain, estimate_count), 0.0)
        self._raw_variance += gain[:, None] * (sample_variance - self._raw_variance)
        floor = self._noise_floor_std**2 * (1.0 + EARLY_SAMPLES / np.maximum(estimate_count, 1))[:, None]
        variances: Floats = np.maximum(self._raw_variance - floor, 0.0)
        return variances
