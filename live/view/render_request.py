"""Requests to draw a robot for the live view, and the viewpoint of the camera that the user moves.

A request has the simulated state of the robot and the viewpoint for one image.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.physics.arrows import Arrow
from quad_env.physics.rendering import Viewpoint

ROTATION_GAIN = 0.4
"""Rotation of the camera per pixel of a mouse drag, degrees."""
ZOOM_GAIN = 0.0015
"""Relative change of the distance between camera and target per unit of the mouse wheel's motion."""
MAX_ELEVATION = 89.0
"""Largest angle of the camera above or below the horizontal plane through its target, degrees."""
DISTANCE_RANGE = (0.4, 30.0)
"""Smallest and largest distance of the camera from its target, m."""
TRACKING_GAIN = 0.15
"""Gain of the low-pass filter of the camera target's height, from 0 to 1 per image.

In each image the target moves vertically by this fraction of its vertical distance to the robot. The fraction is small
so that the picture does not shake.
"""


@dataclass(frozen=True)
class Orbit(Viewpoint):
    """Viewpoint of a camera that the user rotates around a target point with the mouse."""

    follow: bool = True
    """True if the target of the camera follows the robot; False if the target stays in place."""

    def dragged(self, right: float, down: float) -> "Orbit":
        """Return the viewpoint after a mouse drag by `right` pixels to the right and `down` pixels down."""
        elevation = np.clip(self.elevation - ROTATION_GAIN * down, -MAX_ELEVATION, MAX_ELEVATION)
        return replace(self, azimuth=(self.azimuth - ROTATION_GAIN * right) % 360.0, elevation=float(elevation))

    def zoomed(self, wheel: float) -> "Orbit":
        """Return the viewpoint after a turn of the mouse wheel; a positive value moves the camera away."""
        return replace(self, distance=float(np.clip(self.distance * np.exp(ZOOM_GAIN * wheel), *DISTANCE_RANGE)))

    def at(self, robot: NDArray[np.float64]) -> "Orbit":
        """Return the viewpoint of the next image, for a robot at the position `robot`, world frame, (3,), m."""
        if not self.follow:
            return self
        x, y, z = (float(coordinate) for coordinate in robot)
        height = self.target[2] + TRACKING_GAIN * (z - self.target[2])
        return replace(self, target=(x, y, height))

    def for_tile(self, robot: NDArray[np.float64], count: int) -> "Orbit":
        """Return the viewpoint for one robot, if an image shows several robots side by side in tiles.

        The camera is farther away if there are more tiles, because a narrower tile must show the same area.

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
    """Request to draw one robot: state of the simulation, viewpoint and arrows at the time of the request."""

    model: Any
    """`mujoco.MjModel` of the simulation; always the same object while the simulation exists."""
    data: Any
    """`mujoco.MjData` with a copy of the simulation's state at the time of the request."""
    name: str
    """Name of the robot's policy, which is written into the image."""
    viewpoint: Viewpoint
    arrows: Sequence[Arrow]
    """Arrows that are drawn at the robot for command, velocity and pushes."""
