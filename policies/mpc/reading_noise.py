"""Estimator of the variance of the sensor noise, which needs only the noisy readings.

The second difference of a reading z at sample k is d_k = z_k - 2 z_{k-1} + z_{k-2}. For white noise with the variance
σ², the covariance of two consecutive second differences is -4 σ². A smooth motion contributes little to this
covariance, because its second differences are small. Mehra introduced the noise variance from an autocorrelation in "On
the identification of variances and adaptive Kalman filtering", 1970.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain
from policies.mpc.readings import GROUPS

NOISE_FLOOR_STD = np.array([0.001, 0.12, 0.025, 0.0015, 0.4])
"""Noise floor: standard deviation that the noise estimator finds in noise-free readings of a walking robot, (5,).

The noise floor is caused by the motion of the robot. The square of the noise floor is subtracted from the estimated
variance. There is one number for each group of readings: gravity direction (unit vector), angular velocity, rad/s,
linear velocity, m/s, joint angles, rad, and joint speeds, rad/s."""
FILTER_TIME = 0.5
"""Time constant of the low-pass filter of the estimated noise variance, s.

Until this time has passed since the reset, the estimate is the mean of all samples."""
EARLY_SAMPLES = 8
"""Number of samples E in the factor 1 + E/k, which multiplies the noise floor after k estimates of the variance.

The noise floor is the variance that is estimated for noise-free readings. The noise floor is higher in the first
samples after a reset, because an estimate from few samples scatters."""
SAMPLES_WITHOUT_ESTIMATE = 3
"""Number of samples after a reset for which no noise variance is estimated.

The estimate needs two consecutive second differences of the readings, and thus four samples. The second difference of
a reading z at sample k is z_k - 2 z_{k-1} + z_{k-2}."""


class NoiseEstimator(PerRobotState):
    """Estimates the noise variance of the readings of n robots, one variance per group of readings.

    Args:
        period: Control period, s.
        groups: Slices of the m groups in the readings of a robot, adjacent and in order. A group holds readings of one
            quantity, for example all joint angles.
        noise_floor_std: Standard deviation that is estimated for noise-free readings of each group, (m,), in the unit
            of the readings. Its square is subtracted from the estimated variance.
    """

    sample_count: NDArray[np.int64] = per_robot(0)
    """Number of observations of each robot since its reset, (n,)."""
    _last: Floats = per_robot(axis=1)
    """Previous values of the k readings of n robots, (3, n, k), in the units of the readings.

    The first axis holds the readings one sample ago, the readings two samples ago, and the second difference one sample
    ago. The second difference of a reading z at sample k is z_k - 2 z_{k-1} + z_{k-2}."""
    _raw_variance: Floats = per_robot()
    """Low-pass filtered noise variance of each of m groups of readings, (n, m), before the noise floor is subtracted.

    The noise floor is the variance that is estimated for noise-free readings."""

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
        """Update the estimate with the k `readings` of n robots, (n, k), and return the noise variances, (n, m).

        There is one variance for each of the m groups of readings. The noise floor (the variance that is estimated for
        noise-free readings) is subtracted. A variance below the noise floor is returned as zero.
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
