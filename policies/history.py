"""History of observations as network inputs: single earlier frames, and exponential averages."""

import math
import sys
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from policies.memory import PerRobotState, per_robot
from quad_env.config import Bounds, Settings

Frames = NDArray[np.float32]
Age = Annotated[float, Bounds("above 0 s, at most 10 s", sys.float_info.min, 10.0)]


@dataclass(frozen=True)
class Inputs(Settings):
    """Network inputs in addition to the present observation and the base; none by default."""

    lags: tuple[Age, ...] = ()
    """Ages of single earlier observations, s; rounded to whole control steps."""
    averages: tuple[Age, ...] = ()
    """Time constants of exponential averages of the observation, s."""
    clock: Annotated[float, Bounds("from 0 Hz to 50 Hz", 0.0, 50.0)] = 0.0
    """Frequency of a clock, Hz, with its sine and cosine as inputs; 0 for none."""

    @property
    def frames(self) -> int:
        """Number of past frames and averages in the network input."""
        return len(self.lags) + len(self.averages)


class History(PerRobotState):
    """Past frames and averages of n robots; a frame is one scaled observation.

    The first frame of a robot also stands for all frames before it.

    Args:
        inputs: Lags and averages.
        width: Number of values in a frame.
        control_period: Time between two calls of `update`, s.
    """

    _past: Frames = per_robot(axis=1)
    _averages: Frames = per_robot(axis=1)
    _new: NDArray[np.bool_] = per_robot(True)

    def __init__(self, inputs: Inputs, width: int, control_period: float) -> None:
        self.width = width * inputs.frames
        """Number of values that `update` returns for each robot."""
        self._lags = [max(round(lag / control_period), 1) for lag in inputs.lags]
        self._rates = [np.float32(-math.expm1(-control_period / time)) for time in inputs.averages]
        self._now = 0
        past = np.zeros((max(self._lags, default=0) + 1, width), np.float32)
        super().__init__(_past=past, _averages=np.zeros((len(self._rates), width), np.float32))

    def reset_where(self, mask: NDArray[np.bool_]) -> None:
        """Reset the robots where `mask`, (n,), is True."""
        self._new |= mask

    def copy_state_from(self, mask: NDArray[np.bool_], other: "History") -> None:
        """Copy the frames of another history.

        The frames are shifted, because each history has its own index of the newest frame.

        Args:
            mask: Robots that receive frames, (n,) bool.
            other: History of the same size, with one robot for each True in the mask.
        """
        super().copy_state_from(mask, other)
        self._past[:, mask] = np.roll(other._past, self._now - other._now, axis=0)

    def update(self, frame: Frames) -> Frames:
        """Add a `frame`, (n, k), and return the lagged frames, then the averages, (n, `width`)."""
        if self._new.any():
            self._past[:, self._new] = self._averages[:, self._new] = frame[self._new]
            self._new[:] = False
        self._now = (self._now + 1) % len(self._past)
        self._past[self._now] = frame
        for average, rate in zip(self._averages, self._rates, strict=True):
            average += rate * (frame - average)
        lagged = [self._past[self._now - lag] for lag in self._lags]
        return np.concatenate((*lagged, *self._averages), axis=1)
