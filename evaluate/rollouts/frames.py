"""The observer that takes pictures of a robot."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.observers import Step

if TYPE_CHECKING:
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

Frame = NDArray[np.uint8]
"""(height, width, 3)"""
WIDTH, HEIGHT = 640, 480
"""Pixels of a frame, where nothing else is said."""


class Frames:
    """Pictures of the first of n robots, one every so many control steps from a first one on; close it in the end."""

    def __init__(
        self, every: int, first: int = 1, *, width: int = WIDTH, height: int = HEIGHT, camera: str = "track"
    ) -> None:
        self.taken: list[Frame] = []
        self._every, self._first = every, first
        self._view = width, height, camera
        self._camera: Any = None

    def __call__(self, step: Step) -> None:
        """Take a picture if one is due, or if the simulation has diverged, which ends the rollout."""
        if self.due(step) or step.infos["diverged"][0]:
            self.taken.append(self.draw(step.env))

    def due(self, step: Step) -> bool:
        """Whether a picture is to be taken after that control step."""
        return step.number >= self._first and (step.number - self._first) % self._every == 0

    def draw(self, env: "SimpleQuadVectorEnv") -> Frame:
        """The first robot as it is now; ValueError names the cameras that there are."""
        if self._camera is None:
            from quad_env.physics.rendering import Camera

            self._camera = Camera(env.simulation.model, *self._view)
        frame: Frame = self._camera.draw(env.simulation.snapshot(0))
        return frame

    def close(self) -> None:
        """Free the renderer."""
        if self._camera is not None:
            self._camera.close()
