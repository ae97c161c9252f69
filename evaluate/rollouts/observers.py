"""Observers of a rollout: the step that they receive, and the recorder of falls."""

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
"""Fall code -> name of the fall rule; None for code 0."""


@dataclass(frozen=True)
class Step:
    """One control step of n robots, or the start of the robots' episodes as step 0."""

    number: int
    """Number of finished control steps; 0 at the start."""
    env: "SimpleQuadVectorEnv"
    action: Actions
    """Joint targets of the step, or the home pose at the start, (n, 12), rad."""
    observation: NDArray[np.float32]
    """Observation after the step, the input of the policy's next action, (n, k)."""
    infos: dict[str, Any]
    """Infos of the environment, with the readings that `quad_env.task.readings` describes."""


Observer = Callable[[Step], bool | None]
"""Function that receives the start and every control step, and returns True to end the rollout.

An observer may change the policy; the change takes effect with the next action.
"""


class FallRecorder:
    """Observer that records the first fall of n robots, by the environment's rule or by divergence."""

    def __init__(self, count: int, steps: int) -> None:
        self.step = np.full(count, steps, dtype=np.int64)
        """First control step after which the robot had fallen or diverged, (n,); `steps` if it did not fall."""
        self.reason = np.full(count, None, dtype=object)
        """Name of the fall rule in `FALL_REASONS`, or `diverged`, (n,); None if the robot did not fall."""
        self.divergence_step = np.full(count, steps, dtype=np.int64)
        """First control step after which the simulation had diverged, (n,); `steps` if it did not diverge."""
        self._steps = steps

    def __call__(self, step: Step) -> None:
        """Record the falls of a control step; reaching the time limit is not a fall."""
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
        """True for robots that have fallen or diverged so far, (n,)."""
        return np.asarray(self.step < self._steps)
