"""Smith predictor of the present joint angles and speeds from delayed encoder readings.

It integrates the joint accelerations that the controller has planned over the delay of the encoders.
"""

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from quad_env import OBSERVATION
from quad_env.columns import Mask

VELOCITY_OBSERVER_GAIN = 90.0
"""Observer gain: correction of a predicted joint speed per error of the predicted joint angle, 1/s.

With a gain of 100, the corrected speed would remove the error of the angle within one control step of 10 ms."""


class JointPredictor(PerRobotState):
    """Predicts the present joint angles and speeds of n robots from encoder readings that are `delay_steps` old.

    An encoder angle that is one control step old differs from the present angle by the joint speed times 10 ms. The
    prediction is needed because a controller that inverts the servo law would turn this error into a torque error. In a
    trot, the torque error would be 9 N·m.

    The predictor assumes that the joints follow the planned accelerations. It integrates these accelerations from the
    time of the reading to the present. The predicted angle for the time of a reading is compared with the reading, and
    the difference corrects the joint speed (Smith, "Closer control of loops with dead time", 1957).

    Args:
        delay_steps: Delay of the encoder readings, control steps; 0 if the readings are not delayed.
        period: Control period, s.
    """

    _is_started: Mask = per_robot(False)
    """True for robots that have had an encoder reading since their reset, (n,).

    For these robots there is a prediction of the next reading."""
    _expected_angles: Floats = per_robot(np.zeros(12))
    """Predicted joint angles at the measurement time of the next encoder reading, (n, 12), rad."""
    _expected_speeds: Floats = per_robot(np.zeros(12))
    """Predicted joint speeds at the measurement time of the next encoder reading, (n, 12), rad/s."""
    _accelerations: Floats = per_robot(axis=1)
    """Planned joint accelerations of the last control periods, oldest first, (delay_steps, n, 12), rad/s²."""

    def __init__(self, delay_steps: int, period: float) -> None:
        self.delay_steps = delay_steps
        self._period = period
        super().__init__(_accelerations=np.zeros((delay_steps, 12)))

    def predict(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the observations, (n, k), with predicted present instead of delayed joint angles and speeds.

        The `observation`, (n, k), of n robots is returned unchanged if the encoders have no delay.
        """
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
            if number == 0:  # because the next encoder reading is one control period newer than the present reading
                self._expected_angles = angles
                self._expected_speeds = speeds
        self._is_started[:] = True
        predicted = observation.copy()
        predicted[:, OBSERVATION["joint_position"]] = angles
        predicted[:, OBSERVATION["joint_velocity"]] = speeds
        return predicted

    def record(self, acceleration: Floats) -> None:
        """Store the planned joint `acceleration`, (n, 12), rad/s², of the control period that begins now."""
        if self.delay_steps:
            self._accelerations = np.concatenate((self._accelerations[1:], acceleration[None]))
