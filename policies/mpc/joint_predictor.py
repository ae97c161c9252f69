"""Smith predictor of joint angles and speeds, from delayed encoder readings and planned accelerations."""

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from quad_env import OBSERVATION
from quad_env.columns import Mask

VELOCITY_OBSERVER_GAIN = 90.0
"""Correction of the joint speed per error of the predicted angle, 1/s. With 100 one control step would remove it."""


class JointPredictor(PerRobotState):
    """Predicts the present joint angles and speeds of n robots from readings that are `delay_steps` old.

    An encoder angle that is one control step old differs from the present angle by the joint speed times 10 ms. A
    controller that inverts the servo law turns this difference into torque, 9 N·m in a trot. After the reading, the
    joints have followed the planned accelerations. The predictor integrates these accelerations. Each delayed reading
    corrects the prediction for the time of the reading (Smith, "Closer control of loops with dead time", 1957).

    Args:
        delay_steps: Delay of the joint readings, control steps; 0 if the readings are not delayed.
        period: Control period, s.
    """

    _is_started: Mask = per_robot(False)
    """True for robots with a prediction for their next reading, (n,)."""
    _expected_angles: Floats = per_robot(np.zeros(12))
    """Predicted joint angles at the time of the next reading, (n, 12), rad."""
    _expected_speeds: Floats = per_robot(np.zeros(12))
    """Predicted joint speeds at the time of the next reading, (n, 12), rad/s."""
    _accelerations: Floats = per_robot(axis=1)
    """Planned joint accelerations from the time of the next reading on, oldest first, (delay_steps, n, 12), rad/s²."""

    def __init__(self, delay_steps: int, period: float) -> None:
        self.delay_steps = delay_steps
        self._period = period
        super().__init__(_accelerations=np.zeros((delay_steps, 12)))

    def predict(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the observations, (n, k), with predicted joints; unchanged if `delay_steps` is 0."""
        if not self.delay_steps:
            return observation
        period = self._period
        reading = observation[:, OBSERVATION["joint_position"]].astype(np.float64)
        expected = np.where(self._is_started[:, None], self._expected_angles, reading)
        angles = reading
        speeds = self._expected_speeds + VELOCITY_OBSERVER_GAIN * (reading - expected)
        for number, acceleration in enumerate(self._accelerations):
            angles = angles + period * speeds + 0.5 * period**2 * acceleration
            speeds = speeds + period * acceleration
            if number == 0:  # the predicted time is now the time of the next reading
                self._expected_angles = angles
                self._expected_speeds = speeds
        self._is_started[:] = True
        predicted = observation.copy()
        predicted[:, OBSERVATION["joint_position"]] = angles
        predicted[:, OBSERVATION["joint_velocity"]] = speeds
        return predicted

    def record(self, acceleration: Floats) -> None:
        """Record the planned joint accelerations of the control period that begins, (n, 12), rad/s²."""
        if self.delay_steps:
            self._accelerations = np.concatenate((self._accelerations[1:], acceleration[None]))
