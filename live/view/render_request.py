"""Shots of robots: what is to be drawn, and the place of the camera."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.physics.arrows import Arrow
from quad_env.physics.rendering import Viewpoint

TURN, ZOOM = 0.4, 0.0015
"""Degrees a pixel that the mouse is dragged, and share of the distance a unit that its wheel is turned."""
STEEPEST = 89.0
DISTANCES = (0.4, 30.0)
"""m"""
TRACKING_GAIN = 0.15
"""Share of its way to the robot that the camera goes a frame up and down, so that it does not shake with the trunk."""


@dataclass(frozen=True)
class Orbit(Viewpoint):
    """Viewpoint that the mouse turns, and that follows a robot or stays."""

    follow: bool = True

    def dragged(self, right: float, down: float) -> "Orbit":
        """After the mouse was dragged by so many pixels."""
        elevation = np.clip(self.elevation - TURN * down, -STEEPEST, STEEPEST)
        return replace(self, azimuth=(self.azimuth - TURN * right) % 360.0, elevation=float(elevation))

    def zoomed(self, wheel: float) -> "Orbit":
        """After the wheel was turned, away where it is positive."""
        return replace(self, distance=float(np.clip(self.distance * np.exp(ZOOM * wheel), *DISTANCES)))

    def at(self, robot: NDArray[np.float64]) -> "Orbit":
        """A frame later, with a robot there, (3,), world, m."""
        if not self.follow:
            return self
        x, y, z = robot
        return replace(self, target=(float(x), float(y), self.target[2] + TRACKING_GAIN * (float(z) - self.target[2])))

    def for_tile(self, robot: NDArray[np.float64], count: int) -> "Orbit":
        """About a robot there, one of so many side by side, whose narrower pictures show as much."""
        x, y, _ = robot.tolist()
        target = (x, y, self.target[2]) if self.follow else self.target
        return replace(self, target=target, distance=self.distance * count**0.5)


@dataclass(frozen=True)
class RenderRequest:
    """What there is to be seen of one robot at one moment."""

    model: Any
    """mujoco.MjModel of its simulation, the same object for as long as it is one simulation."""
    data: Any
    """mujoco.MjData, a snapshot."""
    name: str
    viewpoint: Viewpoint
    arrows: Sequence[Arrow]
