"""Where joints are now that a robot is shown late: as its own programs have planned since.

An encoder's angle of one control step ago, taken for the present one, is off by the joint's speed times 10 ms; a
controller that inverts the servos' law turns that into torque, 9 N·m in a trot. What the joints have done since is
known: they have followed the accelerations that were asked for. The predictor goes on with those (Smith, Closer control
of loops with dead time, 1957), and each late reading corrects what it had predicted for its moment.
"""

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import Memory, per_robot
from quad_env import OBSERVATION
from quad_env.columns import Mask

SPEED_GAIN = 90.0
"""Correction of the speed per error of the angle that was predicted, 1/s; 100 would be that of one control step."""


class JointPrediction(Memory):
    """Joints of n robots that are shown `late` control steps late, of `period`, s, each."""

    _known: Mask = per_robot(False)
    _angles: Floats = per_robot(np.zeros(12))
    _speeds: Floats = per_robot(np.zeros(12))
    _planned: Floats = per_robot(lambda joints: np.zeros((joints._late, 12)), axis=1)

    def __init__(self, late: int, period: float) -> None:
        self._late, self._period = late, period

    def now(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observations, (n, k), with joints as they are now; themselves where they are not late."""
        if not self._late:
            return observation
        shown = observation[:, OBSERVATION["joint_position"]].astype(np.float64)
        expected = np.where(self._known[:, None], self._angles, shown)
        angles, speeds = shown, self._speeds + SPEED_GAIN * (shown - expected)
        for number, acceleration in enumerate(self._planned):
            angles = angles + self._period * speeds + 0.5 * self._period**2 * acceleration
            speeds = speeds + self._period * acceleration
            if number == 0:  # of the moment that is shown next
                self._angles, self._speeds = angles, speeds
        self._known[:] = True
        out = observation.copy()
        out[:, OBSERVATION["joint_position"]], out[:, OBSERVATION["joint_velocity"]] = angles, speeds
        return out

    def keep(self, acceleration: Floats) -> None:
        """Take note of what the joints are asked for in the control period that begins, (n, 12), rad/s²."""
        if self._late:
            self._planned = np.concatenate((self._planned[1:], acceleration[None]))
