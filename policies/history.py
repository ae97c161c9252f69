"""History of observations as inputs of a policy network.

The history consists of single past observations and of exponential moving averages of the observation.
"""

import math
import sys
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from policies.memory import PerRobotState, per_robot
from quad_env.config import Bounds, Settings

Frames = NDArray[np.float32]
"""Type of the scaled observations of n robots, (n, k), with k numbers per robot."""
MAX_AGE = 10.0
"""Largest age of a past observation that is a network input, and largest time constant of an average, s."""
Age = Annotated[float, Bounds("above 0 s, at most 10 s", sys.float_info.min, MAX_AGE)]
"""Type of the age of an observation or the time constant of an average, s."""
TermName = Literal[
    "projected_gravity", "angular_velocity", "linear_velocity", "joint_position", "joint_velocity", "previous_action",
    "command",
]  # fmt: skip
"""Type of the name of a built-in term of the observation."""


@dataclass(frozen=True)
class Inputs(Settings):
    """Inputs that a policy network gets in addition to the observation and the base policy's action."""

    lags: tuple[Age, ...] = ()
    """Ages of the past observations that are network inputs, s; rounded to whole control steps."""
    averages: tuple[Age, ...] = ()
    """Time constants of the exponential averages of the observation that are network inputs, s."""
    clock: Annotated[float, Bounds("from 0 Hz to 50 Hz", 0.0, 50.0)] = 0.0
    """Frequency of a clock with its sine and cosine as network inputs, Hz; 0: no clock."""
    clock_at_rest: Literal["shown", "hidden"] = "shown"
    """hidden: the two clock inputs are 0 while the velocity command is zero, so that the robot can stand."""
    clock_gain: Annotated[float, Bounds("from 0 to 100 Hz per m/s", 0.0, 100.0)] = 0.0
    """Increase of the clock's frequency per horizontal velocity error in excess of 0.4 m/s, Hz per m/s.

    A robot that is pushed then steps faster, as with a model-based controller."""
    clock_limit: Annotated[float, Bounds("from 0 Hz to 50 Hz", 0.0, 50.0)] = 2.0
    """Largest increase of the clock's frequency, Hz."""
    position_error: Annotated[float, Bounds("from 0 m to 100 m", 0.0, 100.0)] = 0.0
    """Bound of the position error that is a network input, m, and of its yaw error, rad; 0: not an input.

    The position error is the integral of the velocity error since the last change of the command."""
    terms: tuple[TermName, ...] = ()
    """Terms of the observation that are network inputs, in this order; empty: the whole observation.

    With terms, the network has no inputs except these terms and the clock, each with its last `history` values."""
    history: Annotated[int, Bounds("from 1 to 100", 1, 100)] = 1
    """Number of last values of each term and of the clock, one for each action of the network; only with terms."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.terms and self.history != 1:
            raise ValueError(f"Inputs.history: history needs Inputs.terms, got {self.history}; valid: 1")
        if len(set(self.terms)) < len(self.terms):
            raise ValueError(f"Inputs.terms: a term is repeated, got {' '.join(self.terms)}")
        if not self.terms:
            return
        for name in ("lags", "averages"):
            if ages := getattr(self, name):
                given = " ".join(f"{age:g}" for age in ages)
                raise ValueError(f"Inputs.{name}: must be empty with Inputs.terms, got {given}")
        for name in ("clock_gain", "position_error"):
            if value := getattr(self, name):
                raise ValueError(f"Inputs.{name}: must be 0 with Inputs.terms, got {value:g}")

    @property
    def frames(self) -> int:
        """Number of past observations plus number of averages that are network inputs."""
        return len(self.lags) + len(self.averages)


def lag_steps(lag: float, control_period: float) -> int:
    """Return the age of a past observation in control steps, at least one; `lag` and `control_period` are in s."""
    return max(round(lag / control_period), 1)


class History(PerRobotState):
    """Past observations of n robots and their exponential moving averages, as network inputs.

    A frame is the scaled observation of a robot in one control step. The first frame after a reset also stands for all
    frames before the reset.

    Args:
        inputs: Ages of the past frames, and time constants of the averages.
        width: Number of elements of the scaled observation of one robot.
        control_period: Time between two calls of `update`, s.
    """

    _past: Frames = per_robot()
    """Ring buffer of the last scaled observations of n robots, (n, buffer length, k); k numbers per robot."""
    _averages: Frames = per_robot()
    """Exponential moving averages of the scaled observations, (n, number of averages, k), with k numbers per robot."""
    _new: NDArray[np.bool_] = per_robot(True)
    """True for robots that got no observation since their reset, (n,)."""

    def __init__(self, inputs: Inputs, width: int, control_period: float) -> None:
        self.width = width * inputs.frames
        """Number of elements that `update` returns for each robot, for past frames and averages together."""
        self._lags = np.array([lag_steps(lag, control_period) for lag in inputs.lags], np.intp)
        rates = [-math.expm1(-control_period / time) for time in inputs.averages]
        self._rates = np.array(rates, np.float32)[:, None]
        self._num_lagged = width * len(self._lags)
        """Number of elements of the past frames, which precede the averages in the result of `update`."""
        self._now = 0
        past = np.zeros((self._lags.max(initial=0) + 1, width), np.float32)
        super().__init__(_past=past, _averages=np.zeros((len(rates), width), np.float32))

    def reset_where(self, mask: NDArray[np.bool_]) -> None:
        """Reset the robots for which `mask`, (n,) bool, is True; their next observation fills the history."""
        self._new |= mask

    def copy_state_from(self, mask: NDArray[np.bool_], other: "History") -> None:
        """Copy the past frames and averages of another history to some robots of this history.

        The frames are shifted along the ring buffer, because the index of the newest frame differs between the two
        histories.

        Args:
            mask: True for robots of this history that receive frames and averages, (n,) bool.
            other: History with the same inputs, and one robot for each True in `mask`.
        """
        super().copy_state_from(mask, other)
        self._past[mask] = np.roll(other._past, self._now - other._now, axis=1)

    def update(self, frame: Frames, out: Frames | None = None) -> Frames:
        """Add the newest frame of all robots, and return the past frames and averages that are network inputs.

        Args:
            frame: Scaled observation of this control step, (n, k), with k numbers per robot.
            out: Array for the result, (n, `width`); None for a new array.

        Returns:
            First the past frames in the order of `Inputs.lags`, then the averages in the order of `Inputs.averages`,
            (n, `width`).
        """
        if np.count_nonzero(self._new):
            first = frame[self._new][:, None]
            self._past[self._new] = first
            self._averages[self._new] = first
            self._new[:] = False
        self._now = (self._now + 1) % self._past.shape[1]
        self._past[:, self._now] = frame
        result = np.empty((len(frame), self.width), np.float32) if out is None else out
        if len(self._lags):
            lagged = self._past.take(self._now - self._lags, axis=1, mode="wrap")
            result[:, : self._num_lagged] = lagged.reshape(len(frame), -1)
        if len(self._rates):
            self._averages += self._rates * (frame[:, None] - self._averages)
            result[:, self._num_lagged :] = self._averages.reshape(len(frame), -1)
        return result
