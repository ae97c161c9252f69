"""Observers of a rollout: the data of a control step, and the observer that records falls."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions
from quad_env.config import FALL_REASONS

if TYPE_CHECKING:
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

_REASONS = np.array([None, *FALL_REASONS[1:]], dtype=object)
"""Reason of a fall, indexed by the fall code of the environment; None at index 0, which is no fall.

An example is `trunk_contact`.
"""


@dataclass(frozen=True)
class Step:
    """State of n robots after one control step; step 0 is the start of their episodes."""

    number: int
    """Number of control steps that have been simulated; 0 at the start of the episodes."""
    env: "SimpleQuadVectorEnv"
    action: Actions
    """Joint targets that were applied in this step, (n, 12), rad; at the start they are the home pose."""
    observation: NDArray[np.float32]
    """Observation of each robot after the step, k numbers, (n, k); the policy computes its next action from it."""
    infos: dict[str, Any]
    """Infos of the environment: name of a reading, such as `heading_velocity` -> array, (n, …).

    `quad_env.task.readings` describes the readings.
    """


Observer = Callable[[Step], bool | None]
"""Function that receives the start and each control step of a rollout; it returns True to end the rollout.

An observer may change the policy; the change takes effect with the next action of the policy.
"""


class FallRecorder:
    """Observer that records the first fall of each of n robots; a diverged simulation counts as a fall."""

    def __init__(self, count: int, steps: int) -> None:
        self.step = np.full(count, steps, dtype=np.int64)
        """First control step after which the robot had fallen or its simulation had diverged, (n,).

        It is the number of steps if neither has happened.
        """
        self.reason = np.full(count, None, dtype=object)
        """Reason for the fall of each robot, (n,).

        It is the name of the condition that detected the fall, for example `trunk_contact`. It is `diverged` if the
        simulation became unstable, and None if the robot has not fallen.
        """
        self.divergence_step = np.full(count, steps, dtype=np.int64)
        """First control step after which the simulation of the robot had diverged, (n,).

        It is the number of steps if the simulation has not diverged.
        """
        self._steps = steps

    def __call__(self, step: Step) -> None:
        """Record the robots that fell in a control `step`; reaching the time limit of an episode is no fall."""
        fall = step.infos["fall"]
        diverged = step.infos["diverged"]
        index = step.number - 1
        np.minimum(self.divergence_step, index, out=self.divergence_step, where=diverged)
        new = (diverged | (fall > 0)) & (self.step > index)
        if new.any():
            self.step[new] = index
            self.reason[new] = np.where(diverged, "diverged", _REASONS[fall])[new]

    @property
    def fell(self) -> NDArray[np.bool_]:
        """True for robots that have fallen until now, or that have a diverged simulation, (n,)."""
        return np.asarray(self.step < self._steps)
