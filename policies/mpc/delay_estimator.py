"""Estimator of the delay from joint target to joint reading.

The joint speeds are predicted for each candidate delay. The estimate is the candidate with the smallest error of the
predicted joint speeds.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain
from quad_env.columns import Mask

T = TypeVar("T", bound=np.generic)

MAX_DELAY_STEPS = 19
"""Longest candidate for the delay from joint target to joint reading, control steps.

The candidates are all whole numbers from 0 to this number."""


@dataclass(frozen=True)
class DelayEstimatorParameters:
    """Filter time and thresholds of `DelayEstimator`.

    `DelayEstimator` estimates the time from a joint reading until the joint target computed from this reading acts.
    """

    filter_time: float = 1.0
    """Time constant of the low-pass filter of the squared errors of the predicted joint speeds, s.

    Until this time has passed since the reset, a filtered error is the mean of all samples."""
    min_improvement: float = 0.1
    """Smallest reduction of the squared prediction error of the joint speeds that a new delay must give, as a fraction.

    The fraction refers to the mean squared error of the present delay minus the variance of the sensor noise. A smaller
    reduction does not change the estimated delay."""
    noise_fraction: float = 0.1
    """Additional reduction of the squared prediction error, as a fraction of the noise variance of the joint speeds.

    A new delay must reduce the squared prediction error by this amount and the amount of `min_improvement` together."""
    model_error: float = 0.05
    """Mean squared error of the predicted joint speeds that model errors cause even at the true delay, rad²/s²."""
    samples_without_error: int = 2
    """Number of first observations after a reset that do not update the filtered prediction errors."""
    min_samples: int = 16
    """Number of observations after a reset during which the estimated delay stays at its initial value.

    If the motion of the joints has already identified the delay, it may change earlier."""


DEFAULT_PARAMETERS = DelayEstimatorParameters()


class DelayEstimator(PerRobotState):
    """Estimates the control delay of each of n robots, from the predicted and the measured joint speeds.

    The control delay is the time from a joint reading to the time when the joint target computed from it acts.

    Args:
        period: Control period, s.
        joint_delay_steps: Initial estimate, control steps: the delay of the encoders, or 0 if the joint readings are
            the undelayed true values.
        parameters: Filter time and thresholds.
    """

    delays: NDArray[np.int64] = per_robot()
    """Estimated delay of each robot, (n,), control steps.

    It is the time from a joint reading to the time when the joint target computed from it acts."""
    is_identified: Mask = per_robot(False)
    """True for robots that have moved their joints enough since the reset to distinguish the candidate delays, (n,).

    It stays False if encoders read the joints, because their delay is known."""
    _errors: Floats = per_robot(np.zeros(MAX_DELAY_STEPS + 1), axis=1)
    """Low-pass filtered squared error of the predicted joint speeds, (MAX_DELAY_STEPS + 1, n), rad²/s².

    Row k belongs to the candidate delay of k control steps."""

    def __init__(
        self, period: float, joint_delay_steps: int = 0, parameters: DelayEstimatorParameters = DEFAULT_PARAMETERS
    ) -> None:
        self._parameters = parameters
        self._gain = lowpass_gain(period, parameters.filter_time)
        self._has_encoders = joint_delay_steps > 0
        super().__init__(delays=np.int64(joint_delay_steps))

    def update(self, errors: Floats, noise: Floats, sample_count: NDArray[np.int64], is_excited: Mask) -> None:
        """Update the filtered prediction errors, and change the estimated delay if another one predicts better.

        Args:
            errors: Squared error of the predicted joint speeds, mean over the joints, (MAX_DELAY_STEPS + 1, n),
                rad²/s². Row k belongs to the candidate delay of k control steps.
            noise: Noise variance of the joint speeds, (n,), rad²/s².
            sample_count: Number of observations since the reset, (n,).
            is_excited: True for robots that move their joints, because their noise measurement is over, (n,).
        """
        p = self._parameters
        error_count = sample_count - p.samples_without_error
        gain = warm_start_gain(self._gain, error_count)
        self._errors += np.where(error_count > 0, gain * (errors - self._errors), 0.0)
        present_error = self.at_delay(self._errors)
        min_error = self._errors.min(axis=0)
        noise_margin = p.noise_fraction * noise
        shows_motion = self._errors[-1] - min_error > p.model_error + noise_margin
        self.is_identified |= shows_motion & is_excited & (not self._has_encoders)
        margin = p.min_improvement * np.maximum(present_error - noise, p.model_error) + noise_margin
        may_change = self.is_identified | (sample_count > p.min_samples)
        is_better = (present_error - min_error > margin) & may_change
        self.delays = np.where(is_better, self._errors.argmin(axis=0), self.delays)

    def at_delay(self, history: NDArray[T]) -> NDArray[T]:
        """Return for each of n robots the item of `history` that is as old as the estimated delay of the robot, (n, …).

        `history` holds one item per control step and robot, newest first, (MAX_DELAY_STEPS + 1 or more, n, …).
        """
        return history[self.delays, np.arange(len(self.delays))]
