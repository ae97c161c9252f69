"""Render requests: state of a robot and viewpoint of the camera for one frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.physics.arrows import Arrow
from quad_env.physics.rendering import Viewpoint

ROTATION_GAIN = 0.4
"""Camera rotation per pixel of a mouse drag, degrees."""
ZOOM_GAIN = 0.0015
"""Relative change of the camera's distance per unit of the mouse wheel."""
MAX_ELEVATION = 89.0
"""Largest angle of the camera above or below the horizontal, degrees."""
DISTANCE_RANGE = (0.4, 30.0)
"""Smallest and largest distance of the camera, m."""
TRACKING_GAIN = 0.15
"""Vertical motion of the camera target per frame, as a fraction of the vertical distance to the robot.

The fraction is small so that the picture does not shake.
"""


@dataclass(frozen=True)
class Orbit(Viewpoint):
    """Viewpoint of a camera that orbits a point; the user rotates it with the mouse."""

    follow: bool = True
    """True if the camera follows the robot; False if the camera stays in place."""

    def dragged(self, right: float, down: float) -> "Orbit":
        """Return the viewpoint after a mouse drag of `right` and `down` pixels."""
        elevation = np.clip(self.elevation - ROTATION_GAIN * down, -MAX_ELEVATION, MAX_ELEVATION)
        return replace(self, azimuth=(self.azimuth - ROTATION_GAIN * right) % 360.0, elevation=float(elevation))

    def zoomed(self, wheel: float) -> "Orbit":
        """Return the viewpoint after the mouse wheel turned by `wheel`; positive values move the camera away."""
        return replace(self, distance=float(np.clip(self.distance * np.exp(ZOOM_GAIN * wheel), *DISTANCE_RANGE)))

    def at(self, robot: NDArray[np.float64]) -> "Orbit":
        """Return the viewpoint of the next frame for the position `robot`, world frame, (3,), m."""
        if not self.follow:
            return self
        x, y, z = (float(coordinate) for coordinate in robot)
        height = self.target[2] + TRACKING_GAIN * (z - self.target[2])
        return replace(self, target=(x, y, height))

    def for_tile(self, robot: NDArray[np.float64], count: int) -> "Orbit":
        """Return the viewpoint of one tile of a frame with several tiles side by side.

        The camera is farther away if there are more tiles, because a narrow tile must show the same area.

        Args:
            robot: Position of the robot, world frame, (3,), m.
            count: Number of tiles side by side.

        Returns:
            Viewpoint of the robot's tile.
        """
        x, y, _ = robot.tolist()
        target = (x, y, self.target[2]) if self.follow else self.target
        return replace(self, target=target, distance=self.distance * count**0.5)


@dataclass(frozen=True)
class RenderRequest:
    """Scene of one robot at one time, for the render thread to draw."""

    model: Any
    """`mujoco.MjModel` of the simulation; the same object as long as the simulation exists."""
    data: Any
    """`mujoco.MjData` with a snapshot of the simulation's state."""
    name: str
    """Name of the policy."""
    viewpoint: Viewpoint
    arrows: Sequence[Arrow]
    """Arrows of command, velocity and pushes."""
