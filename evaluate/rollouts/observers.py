"""What the observers of a rollout receive at every control step; the observer of falls."""

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
"""Name of each code of a fall in an episode."""


@dataclass(frozen=True)
class Step:
    """One control step of n robots, or the start of their episodes."""

    number: int
    """Control steps that are done; 0 at the start."""
    env: "SimpleQuadVectorEnv"
    action: Actions
    """Joint targets of the step, rad, (n, 12); at the start the home pose."""
    observation: NDArray[np.float32]
    """The policy's next observation, (n, k)."""
    infos: dict[str, Any]
    """Infos of the environment, its readings among them; see `quad_env.task.readings`."""


Observer = Callable[[Step], bool | None]
"""Receives the start and every control step, in order; its changes of the policy act from the next action on.

True ends the rollout.
"""


class FallRecorder:
    """First fall of each of n robots by the environment's rule; a simulation that diverges is one too."""

    def __init__(self, count: int, steps: int) -> None:
        self.step = np.full(count, steps, dtype=np.int64)
        """Index of the first control step after which the robot was fallen or diverged, (n,); `steps` without one."""
        self.reason = np.full(count, None, dtype=object)
        """Name of `FALL_REASONS`, or `diverged`, (n,); None without a fall."""
        self.divergence_step = np.full(count, steps, dtype=np.int64)
        """Index of the first control step after which the simulation had diverged, (n,); `steps` without one."""
        self._steps = steps

    def __call__(self, step: Step) -> None:
        """Take note of the falls of a control step; a time-out is none."""
        fall, diverged, index = step.infos["fall"], step.infos["diverged"], step.number - 1
        np.minimum(self.divergence_step, index, out=self.divergence_step, where=diverged)
        new = (diverged | (fall > 0)) & (self.step > index)
        if new.any():
            self.step[new] = index
            self.reason[new] = np.where(diverged, "diverged", _REASONS[fall])[new]

    @property
    def fell(self) -> NDArray[np.bool_]:
        """Whether each robot has fallen or diverged by now, (n,)."""
        return np.asarray(self.step < self._steps)
