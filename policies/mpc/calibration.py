"""Calibration after a reset: the robot stands still and then bends its legs, before it walks.

While the robot stands still, the noise of its sensors is measured. The motion of the joints while the legs bend shows
the delay from joint target to joint reading.
"""

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.delay_estimator import MAX_DELAY_STEPS
from quad_env.columns import Mask
from quad_env.robots.robot import Robot

CALIBRATION_STEPS = (4, 8)
"""Durations of the noise measurement after a reset, control steps.

The first duration is for robots without sensor noise, the second duration for robots with sensor noise."""
CALIBRATION_BEND = 1.1
"""Factor on the joint angles of the home pose in the second phase of the calibration, in which the legs bend.

The motion of the joints is needed to estimate the delay from joint target to joint reading."""


class Calibration(PerRobotState):
    """Phases of the calibration of n robots after a reset, and their joint targets meanwhile.

    In the first phase, a robot stands in the home pose while the noise of its sensor readings is measured. In the
    second phase, it bends its legs, if the delay from joint target to joint reading is unknown. This phase ends when
    the delay is identified, or after the longest candidate delay.

    Args:
        robot: Robot model; it supplies the home pose.
        identifies_delay: True if the delay from joint target to joint reading must be estimated. False if it is known,
            because encoders with a known delay read the joints; the second phase is then left out.
    """

    is_active: Mask = per_robot(True)
    """True for robots that are still in calibration, because their sensor noise or delay is not known yet, (n,)."""
    measures_noise: Mask = per_robot(True)
    """True for robots in the first phase of the calibration: they stand while the sensor noise is measured, (n,)."""

    def __init__(self, robot: Robot, *, identifies_delay: bool) -> None:
        self._home_pose = robot.home_pose
        self._max_bend_steps = MAX_DELAY_STEPS if identifies_delay else 0
        super().__init__()

    def update(self, sample_count: NDArray[np.int64], is_noisy: Mask, delay_identified: Mask) -> None:
        """Update the calibration phase of each robot; called once per control step.

        Args:
            sample_count: Number of observations since the reset, (n,).
            is_noisy: True for robots with noisy sensor readings, (n,).
            delay_identified: True for robots with a delay identified from joint motion, (n,).
        """
        quiet_steps, noisy_steps = CALIBRATION_STEPS
        steps_after_noise = sample_count - np.where(is_noisy, noisy_steps, quiet_steps)
        self.measures_noise = steps_after_noise <= 0
        self.is_active = self.measures_noise | ~delay_identified & (steps_after_noise <= self._max_bend_steps)

    def targets(self, targets: Floats) -> Floats:
        """Return the joint targets of n robots for a control step, (n, 12), rad.

        In the first phase of the calibration, they are the home pose. In the second phase, they are the home pose times
        `CALIBRATION_BEND`, so that the legs bend. After the calibration, they are the given `targets`, (n, 12), rad.
        """
        bend = np.where(self.measures_noise, 1.0, CALIBRATION_BEND)[:, None]
        return np.where(self.is_active[:, None], bend * self._home_pose, targets)
