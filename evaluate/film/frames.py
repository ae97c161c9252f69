"""Frames of a robot as it moves: what films and pictures are made of."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quad_env.cli.command_line import UsageError
from quad_env.physics.arrows import Arrow

if TYPE_CHECKING:
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

Frame = NDArray[np.uint8]
"""(height, width, 3)"""


class Filming:
    """Draws frames of the first of n robots, all of one size (width, height), pixels; close it in the end."""

    def __init__(self, size: tuple[int, int], camera: str = "track") -> None:
        self._view = *size, camera
        self._camera: Any = None

    def draw(self, env: "SimpleQuadVectorEnv", arrows: Sequence[Arrow] = ()) -> Frame:
        """The first robot as it is now, with these arrows.

        Raises:
            ValueError: there is no such camera; names those that there are.
            UsageError: nothing can be drawn here.
        """
        from quad_env.physics.rendering import Camera

        try:
            if self._camera is None:
                self._camera = Camera(env.simulation.model, *self._view)
            frame: Frame = self._camera.draw(env.simulation.snapshot(0), arrows=arrows)
        except ValueError:
            raise
        except Exception as error:  # whatever the graphics driver fails with
            raise UsageError(f"nothing can be drawn here ({type(error).__name__}: {error})") from error
        return frame

    def close(self) -> None:
        """Free the renderer."""
        if self._camera is not None:
            self._camera.close()
