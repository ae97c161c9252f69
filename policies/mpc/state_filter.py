"""Kalman filter that combines noisy sensor readings with their prediction one control step ago."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.readings import GROUPS, JOINT_POSITION, JOINT_VELOCITY
from quad_env.columns import Mask

PROCESS_STD = np.array([0.004, 0.15, 0.04, 0.003, 0.6])
"""Standard deviation of the process noise per control step, for each group of readings, (5,).

Gravity direction (unit vector), angular velocity, rad/s, linear velocity, m/s, joint angles, rad, joint speeds, rad/s.
"""
ENCODER_PROCESS_STD = np.array([0.0005, 0.1])
"""Standard deviation of the process noise of joint angle, rad, and joint speed, rad/s, if encoders read the joints.

It is smaller than in `PROCESS_STD`, because the prediction uses the estimated contacts if encoders read the joints."""
ENCODER_NOISE_STD = np.array([0.0011, 1e3])
"""Standard deviation of the noise of 14-bit encoders: joint angle, rad, and joint speed, rad/s.

The standard deviation of the joint speed is so large that the filter ignores this reading. The reason is that the
difference of two encoder samples is not the speed at the time of the last sample."""


class KalmanGains(NamedTuple):
    """Kalman gains of n robots: corrections per innovation (reading minus predicted reading)."""

    base: Floats
    """Scalar gains of gravity direction, angular velocity and linear velocity, (n, 3)."""
    joints: Floats
    """Gain matrix of a joint, from the innovations of angle and speed to the corrections of both, (n, 2, 2)."""


class StateFilter(PerRobotState):
    """Kalman filter of the readings of n robots.

    Gravity direction, angular velocity and linear velocity have one variance each. All joints of a robot share one
    covariance matrix of joint angle and speed.

    Args:
        period: Control period, s.
        has_encoders: True if encoders read the joints. The readings of every robot are then filtered; otherwise only
            noisy readings are filtered.
    """

    _base_variance: Floats = per_robot(np.zeros(3))
    """Error variances of gravity direction (unit vector), angular velocity, rad²/s², and velocity, m²/s², (n, 3)."""
    _joint_covariance: Floats = per_robot(np.zeros((2, 2)))
    """Error covariance of joint angle, rad, and joint speed, rad/s, (n, 2, 2)."""

    def __init__(self, period: float, *, has_encoders: bool) -> None:
        self._has_encoders = has_encoders
        # The state transition F of a joint adds period times speed to the angle.
        self._joint_transition = np.array([[1.0, period], [0.0, 1.0]])
        self._joint_process_std = ENCODER_PROCESS_STD if has_encoders else PROCESS_STD[3:]
        self._joint_noise_std = ENCODER_NOISE_STD if has_encoders else np.zeros(2)
        super().__init__()

    def needs_filter(self, noise: Floats) -> Mask:
        """Return True for robots with readings that need the filter, (n,); `noise`: noise variances, (n, 5).

        These are all robots if encoders read the joints, otherwise the robots with noise in any group of readings.
        """
        needs_filter: Mask = (noise.max(axis=1) > 0.0) | self._has_encoders
        return needs_filter

    def correct(self, readings: Floats, predicted: Floats, noise: Floats, sample_count: NDArray[np.int64]) -> Floats:
        """Return the filtered readings x = x⁻ + K (z - x⁻), with the Kalman gain K.

        The first readings after a reset are returned unchanged, because there is no prediction for them.

        Args:
            readings: Sensor readings z, (n, 33).
            predicted: Prediction x⁻ of the readings from the state one control step ago, (n, 33).
            noise: Noise variance of each group of readings, (n, 5).
            sample_count: Number of observations since the reset, (n,).

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
        """Update the error covariance by one control step, and return the Kalman gains.

        The covariance is propagated, P⁻ = F P Fᵀ + Q, and corrected, P = (1 - K) P⁻, with the gain K = P⁻ (P⁻ + R)⁻¹. F
        is the state transition, Q the process noise and R the noise of the readings. The first reading after a reset
        does not change P, because there is no prediction for it.

        Args:
            noise: Noise variance of each group of readings, (n, 5).
            is_first: True for robots with their first reading since the reset, (n,).

        Returns:
            Kalman gains K.
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
        """Set the error covariance of the robots in `mask`, (n,), to zero, because their readings are exact."""
        self._base_variance[mask] = 0.0
        self._joint_covariance[mask] = 0.0
