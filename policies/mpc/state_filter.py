"""Kalman filter that combines noisy sensor readings with their prediction from the state one control step ago."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.readings import GROUPS, JOINT_POSITION, JOINT_VELOCITY
from quad_env.columns import Mask

PROCESS_STD = np.array([0.004, 0.15, 0.04, 0.003, 0.6])
"""Standard deviation of the Kalman filter's process noise per control step, for each group of sensor readings, (5,).

The groups are gravity direction (unit vector), angular velocity, rad/s, linear velocity, m/s, joint angles, rad, and
joint speeds, rad/s."""
ENCODER_PROCESS_STD = np.array([0.0005, 0.1])
"""Standard deviation of the process noise per control step if encoders read the joints, (2,).

The two numbers belong to the joint angle, rad, and the joint speed, rad/s. They are smaller than in `PROCESS_STD`,
because the prediction is more accurate: with encoders it uses the estimated contacts."""
ENCODER_NOISE_STD = np.array([0.0011, 1e3])
"""Standard deviation of the noise of 14-bit joint encoders, (2,): joint angle, rad, and joint speed, rad/s.

The number of the joint speed is so large that the filter ignores the measured speed. The measured speed is ignored
because the difference of two encoder samples is not the speed at the time of the last sample."""


class KalmanGains(NamedTuple):
    """Kalman gains of n robots: corrections per innovation (reading minus predicted reading)."""

    base: Floats
    """Scalar Kalman gains of gravity direction, angular velocity and linear velocity of each robot, (n, 3)."""
    joints: Floats
    """Kalman gain matrix for every joint of a robot, (n, 2, 2).

    It maps the innovations of joint angle, rad, and joint speed, rad/s, to the corrections of angle and speed."""


class StateFilter(PerRobotState):
    """Kalman filter of the sensor readings of n robots; the filtered readings give the state of the robots.

    Gravity direction, angular velocity and linear velocity of a robot have one error variance each. All joints of a
    robot share one error covariance matrix of joint angle and joint speed.

    Args:
        period: Control period, s.
        has_encoders: True if encoders read the joints. The readings of every robot are then filtered. Otherwise only
            robots with noisy readings are filtered.
    """

    _base_variance: Floats = per_robot(np.zeros(3))
    """Error variances of the filtered trunk readings of each robot, (n, 3).

    They belong to gravity direction (unit vector), angular velocity, rad²/s², and linear velocity, m²/s²."""
    _joint_covariance: Floats = per_robot(np.zeros((2, 2)))
    """Error covariance matrix of filtered joint angle, rad, and joint speed, rad/s, of each robot, (n, 2, 2).

    All joints of a robot share one matrix."""

    def __init__(self, period: float, *, has_encoders: bool) -> None:
        self._has_encoders = has_encoders
        # Kalman state transition F of a joint: the angle increases by the period times the speed.
        self._joint_transition = np.array([[1.0, period], [0.0, 1.0]])
        self._joint_process_std = ENCODER_PROCESS_STD if has_encoders else PROCESS_STD[3:]
        self._joint_noise_std = ENCODER_NOISE_STD if has_encoders else np.zeros(2)
        super().__init__()

    def needs_filter(self, noise: Floats) -> Mask:
        """Return True for robots with sensor readings that need the filter, (n,).

        If encoders read the joints, all robots need it. Otherwise a robot needs it if any of the five groups of
        readings is noisy. `noise`: noise variance of each group, (n, 5).
        """
        needs_filter: Mask = (noise.max(axis=1) > 0.0) | self._has_encoders
        return needs_filter

    def correct(self, readings: Floats, predicted: Floats, noise: Floats, sample_count: NDArray[np.int64]) -> Floats:
        """Return the filtered readings x = x⁻ + K (z - x⁻), with the Kalman gain K.

        The first readings after a reset are returned unchanged, because there is no prediction for them.

        Args:
            readings: Sensor readings z of n robots, (n, 33), in the order of `policies.mpc.readings.GROUPS`.
            predicted: Prediction x⁻ of the readings from the state one control step ago, (n, 33).
            noise: Noise variance of each of the five groups of readings, (n, 5).
            sample_count: Number of observations of each robot since its reset, (n,).

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

        The error covariance P is propagated to P⁻ = F P Fᵀ + Q. It is then corrected to P = (1 - K) P⁻, with the Kalman
        gain K = P⁻ (P⁻ + R)⁻¹. F is the state transition matrix, Q the covariance of the process noise, and R the
        covariance of the sensor noise. The first reading after a reset does not change P, because there is no
        prediction for it.

        Args:
            noise: Noise variance of each of the five groups of readings, (n, 5).
            is_first: True for robots with their first reading since the reset, (n,).

        Returns:
            Kalman gains K of the n robots.
        """
        prior_variance = self._base_variance + PROCESS_STD[:3] ** 2
        base_gain = prior_variance / (prior_variance + noise[:, :3])
        self._base_variance = np.where(is_first[:, None], self._base_variance, (1.0 - base_gain) * prior_variance)
        # Angle and speed of a joint share a covariance matrix, because the angle also gives information on the speed.
        transition = self._joint_transition
        prior = transition @ self._joint_covariance @ transition.T + np.diag(self._joint_process_std**2)
        measurement_noise = (noise[:, 3:] + self._joint_noise_std**2)[:, None] * np.eye(2)
        joint_gain = prior @ np.linalg.inv(prior + measurement_noise)
        self._joint_covariance = np.where(is_first[:, None, None], self._joint_covariance, prior - joint_gain @ prior)
        return KalmanGains(base_gain, joint_gain)

    def clear_covariance(self, mask: Mask) -> None:
        """Set the error covariance of the robots in `mask`, (n,), to zero, because their readings are noise-free."""
        self._base_variance[mask] = 0.0
        self._joint_covariance[mask] = 0.0
