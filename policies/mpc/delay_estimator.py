"""Estimate of the delay from joint target to joint reading, by the prediction errors of candidates."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain
from quad_env.columns import Mask

T = TypeVar("T", bound=np.generic)

MAX_DELAY_STEPS = 19
"""Longest candidate delay, control steps."""


@dataclass(frozen=True)
class DelayEstimatorParameters:
    """Thresholds of the delay estimate."""

    filter_time: float = 1.0
    """Time constant of the mean squared prediction errors, s. Before this time has passed, they are running means."""
    min_improvement: float = 0.1
    """Smallest reduction of the error by a new delay, as a fraction of the present error minus the noise variance."""
    noise_fraction: float = 0.1
    """Further reduction that a new delay must give, as a fraction of the noise variance."""
    model_error: float = 0.05
    """Mean squared error of the joint speeds that remains at the true delay, rad²/s²."""
    samples_without_error: int = 2
    """Number of samples after a reset before the prediction errors count."""
    min_samples: int = 16
    """Number of samples before the delay may change, for robots with a delay that is not identified yet."""


DEFAULT_PARAMETERS = DelayEstimatorParameters()


class DelayEstimator(PerRobotState):
    """Estimates the delay of each of n robots, so that the targets explain the joint speeds best.

    Args:
        period: Control period, s.
        joint_delay_steps: Delay of the encoders, control steps, from which the estimate starts; 0 if the joint readings
            are true values.
        parameters: Thresholds.
    """

    delays: NDArray[np.int64] = per_robot()
    """Control steps from the reading that a target is based on to the time when the target acts, (n,)."""
    is_identified: Mask = per_robot(False)
    """True once motion has shown a delay, (n,)."""
    _errors: Floats = per_robot(np.zeros(MAX_DELAY_STEPS + 1), axis=1)
    """Mean squared prediction error of each candidate delay, (MAX_DELAY_STEPS + 1, n), rad²/s²."""

    def __init__(
        self, period: float, joint_delay_steps: int = 0, parameters: DelayEstimatorParameters = DEFAULT_PARAMETERS
    ) -> None:
        self._parameters = parameters
        self._gain = lowpass_gain(period, parameters.filter_time)
        self._has_encoders = joint_delay_steps > 0
        super().__init__(delays=np.int64(joint_delay_steps))

    def update(self, errors: Floats, noise: Floats, sample_count: NDArray[np.int64], is_excited: Mask) -> None:
        """Update the mean prediction errors, and change the delay if another candidate has a smaller error.

        Args:
            errors: Squared error of the joint speeds, mean over the joints, by candidate delay,
                (MAX_DELAY_STEPS + 1, n), rad²/s².
            noise: Noise variance of the joint speeds, (n,), rad²/s².
            sample_count: Readings since the reset, (n,).
            is_excited: True for robots that may move their joints, because their noise measurement is over, (n,).
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
        """Return the entry of each robot at its delay, (n, …), from a `history` with the newest entry first.

        `history`: (MAX_DELAY_STEPS + 1, n, …).
        """
        return history[self.delays, np.arange(len(self.delays))]
