"""Calibration after a reset: stand to measure the noise, then bend the legs to estimate the delay."""

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.delay_estimator import MAX_DELAY_STEPS
from quad_env.columns import Mask
from quad_env.robots.robot import Robot

CALIBRATION_STEPS = (4, 8)
"""Control steps of the noise measurement: first for robots in which no noise is found, then for the others."""
CALIBRATION_BEND = 1.1
"""Factor on the joint angles of the home pose that excites the delay estimate."""


class Calibration(PerRobotState):
    """Phases of the calibration of n robots.

    A robot stands in the home pose while the noise of its readings is measured. If the delay of the joint readings is
    unknown, the robot then bends its legs. It stops when the motion has shown the delay, or after the longest candidate
    delay.

    Args:
        robot: Robot of the targets.
        identifies_delay: False where the delay of the encoders is known.
    """

    is_active: Mask = per_robot(True)
    """True for robots in calibration: noise or delay is not known yet, (n,)."""
    measures_noise: Mask = per_robot(True)
    """True for robots in the first phase, in which the noise is measured, (n,)."""

    def __init__(self, robot: Robot, *, identifies_delay: bool) -> None:
        self._home_pose = robot.home_pose
        self._max_bend_steps = MAX_DELAY_STEPS if identifies_delay else 0
        super().__init__()

    def update(self, sample_count: NDArray[np.int64], is_noisy: Mask, delay_identified: Mask) -> None:
        """Advance the phases by one control step.

        Args:
            sample_count: Readings since the reset, (n,).
            is_noisy: Robots with noisy readings, (n,).
            delay_identified: True for robots with a delay that motion has shown, (n,).
        """
        quiet_steps, noisy_steps = CALIBRATION_STEPS
        steps_after_noise = sample_count - np.where(is_noisy, noisy_steps, quiet_steps)
        self.measures_noise = steps_after_noise <= 0
        self.is_active = self.measures_noise | ~delay_identified & (steps_after_noise <= self._max_bend_steps)

    def targets(self, targets: Floats) -> Floats:
        """Return joint targets, (n, 12), rad: home pose or bent legs in calibration, else `targets`."""
        bend = np.where(self.measures_noise, 1.0, CALIBRATION_BEND)[:, None]
        return np.where(self.is_active[:, None], bend * self._home_pose, targets)
