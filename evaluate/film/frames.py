"""Frames of a robot as it moves."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.observers import Step
from quad_env.cli.command_line import UsageError
from quad_env.physics.marks import Mark

if TYPE_CHECKING:
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

Frame = NDArray[np.uint8]
"""(height, width, 3)"""
CAMERAS = ("track", "side")
"""Every robot's."""


class Frames:
    """Frames of the first of n robots; as an observer, one every so many control steps from a first one on.

    Close it in the end.
    """

    def __init__(self, every: int = 1, first: int = 0, *, width: int, height: int, camera: str = CAMERAS[0]) -> None:
        self.taken: list[Frame] = []
        self._every, self._first = every, first
        self._view = width, height, camera
        self._camera: Any = None

    def __call__(self, step: Step) -> None:
        """Take a picture if one is due, or if the simulation has diverged, which ends the rollout."""
        due = step.number >= self._first and (step.number - self._first) % self._every == 0
        if due or step.infos["diverged"][0]:
            self.taken.append(self.draw(step.env))

    def draw(self, env: "SimpleQuadVectorEnv", marks: Sequence[Mark] = ()) -> Frame:
        """The first robot as it is now, with these marks.

        Raises:
            ValueError: there is no such camera; names those that there are.
            UsageError: nothing can be drawn here.
        """
        from quad_env.physics.rendering import Camera

        try:
            if self._camera is None:
                self._camera = Camera(env.simulation.model, *self._view)
            frame: Frame = self._camera.draw(env.simulation.snapshot(0), marks=marks)
        except ValueError:
            raise
        except Exception as error:  # whatever the graphics driver fails with
            raise UsageError(f"nothing can be drawn here ({type(error).__name__}: {error})") from error
        return frame

    def close(self) -> None:
        """Free the renderer."""
        if self._camera is not None:
            self._camera.close()
