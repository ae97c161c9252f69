"""Kalman filter that combines the readings with their prediction from the state one control step ago."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.readings import GROUPS, JOINT_POSITION, JOINT_VELOCITY
from quad_env.columns import Mask

PROCESS_STD = np.array([0.004, 0.15, 0.04, 0.003, 0.6])
"""Standard deviation of the process noise of each group per control step: unit vector, rad/s, m/s, rad, rad/s."""
ENCODER_PROCESS_STD = np.array([0.0005, 0.1])
"""Standard deviation of the process noise of joint angle and speed if encoders read the joints, rad and rad/s.

The prediction uses the estimated contacts in this case."""
ENCODER_NOISE_STD = np.array([0.0011, 1e3])
"""Standard deviation of the noise of 14-bit encoders: joint angle, rad, and joint speed, rad/s.

The value of the speed is so large that the filter ignores the speed. A difference of two samples is not the speed at
the time of the last sample."""


class KalmanGains(NamedTuple):
    """Gains of the readings of n robots."""

    base: Floats
    """Gains of gravity, angular velocity and velocity, (n, 3)."""
    joints: Floats
    """Gains from the innovations of joint angle and speed to both, (n, 2, 2)."""


class StateFilter(PerRobotState):
    """Kalman filter of n robots, with one variance per group of the base and one covariance of all joints.

    Args:
        period: Control period, s.
        has_encoders: True if encoders read the joints. The readings of every robot are then filtered, otherwise only
            the readings of robots with noise.
    """

    _base_variance: Floats = per_robot(np.zeros(3))
    """Variances of gravity, angular velocity and velocity, (n, 3)."""
    _joint_covariance: Floats = per_robot(np.zeros((2, 2)))
    """Covariance of joint angle and speed, (n, 2, 2)."""

    def __init__(self, period: float, *, has_encoders: bool) -> None:
        self._has_encoders = has_encoders
        # State transition F: the angle increases by period · speed.
        self._joint_transition = np.array([[1.0, period], [0.0, 1.0]])
        self._joint_process_std = ENCODER_PROCESS_STD if has_encoders else PROCESS_STD[3:]
        self._joint_noise_std = ENCODER_NOISE_STD if has_encoders else np.zeros(2)
        super().__init__()

    def needs_filter(self, noise: Floats) -> Mask:
        """Return True for robots that need filtered readings, (n,); `noise`: variance of each group, (n, 5)."""
        needs_filter: Mask = (noise.max(axis=1) > 0.0) | self._has_encoders
        return needs_filter

    def correct(self, readings: Floats, predicted: Floats, noise: Floats, sample_count: NDArray[np.int64]) -> Floats:
        """Return the filtered readings, x = x⁻ + K (z - x⁻); a first reading is returned unchanged.

        Args:
            readings: Readings z, (n, 33).
            predicted: Prediction x⁻ from one control step ago, (n, 33).
            noise: Noise variance of each group, (n, 5).
            sample_count: Number of readings since the reset, (n,).

        Returns:
            Filtered readings, (n, 33).
        """
        is_first = sample_count == 1
        gains = self.update_gains(noise, is_first)
        filtered = np.where(is_first[:, None], readings, predicted)
        innovation = readings - filtered
        for number, group in enumerate(GROUPS[:3]):
            filtered[:, group] += gains.base[:, number, None] * innovation[:, group]
        joint_innovation = np.stack((innovation[:, JOINT_POSITION], innovation[:, JOINT_VELOCITY]), axis=1)
        corrections = gains.joints @ joint_innovation
        filtered[:, JOINT_POSITION] += corrections[:, 0]
        filtered[:, JOINT_VELOCITY] += corrections[:, 1]
        return filtered

    def update_gains(self, noise: Floats, is_first: Mask) -> KalmanGains:
        """Propagate the covariance by one control step, correct it and return the gains.

        P⁻ = F P Fᵀ + Q, K = P⁻ (P⁻ + R)⁻¹, P = (1 - K) P⁻. A first reading does not change P, because there was no
        prediction.

        Args:
            noise: Noise variance of each group, (n, 5).
            is_first: True for robots with their first reading since the reset, (n,).

        Returns:
            Gains K.
        """
        prior_variance = self._base_variance + PROCESS_STD[:3] ** 2
        base_gain = prior_variance / (prior_variance + noise[:, :3])
        self._base_variance = np.where(is_first[:, None], self._base_variance, (1.0 - base_gain) * prior_variance)
        # Angle and speed share a covariance, because the angle of a joint also gives information on its speed.
        transition = self._joint_transition
        prior = transition @ self._joint_covariance @ transition.T + np.diag(self._joint_process_std**2)
        measurement_noise = (noise[:, 3:] + self._joint_noise_std**2)[:, None] * np.eye(2)
        joint_gain = prior @ np.linalg.inv(prior + measurement_noise)
        self._joint_covariance = np.where(is_first[:, None, None], self._joint_covariance, prior - joint_gain @ prior)
        return KalmanGains(base_gain, joint_gain)

    def clear_covariance(self, mask: Mask) -> None:
        """Set the covariance of the robots in `mask`, (n,), to zero; their readings are taken as exact."""
        self._base_variance[mask] = 0.0
        self._joint_covariance[mask] = 0.0
