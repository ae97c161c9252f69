"""Pictures of a session: the robots, arrows, and the place of the camera."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.film.scene import Scene
from evaluate.rollouts.observers import Step
from live.session import Session
from quad_env.physics.arrows import Arrow
from quad_env.physics.rendering import Viewpoint

TURN, ZOOM = 0.4, 0.0015
"""Degrees a pixel that the mouse is dragged, and share of the distance a unit that its wheel is turned."""
STEEPEST = 89.0
DISTANCES = (0.4, 30.0)
"""m"""
FOLLOWING = 0.15
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
        return replace(self, target=(float(x), float(y), self.target[2] + FOLLOWING * (float(z) - self.target[2])))


@dataclass(frozen=True)
class Picture:
    """What there is to be seen at one moment."""

    model: Any
    """mujoco.MjModel of the simulation, the same object for as long as it is one simulation."""
    robots: Sequence[Any]
    """mujoco.MjData of each robot."""
    places: Sequence[tuple[float, float, float]]
    """What the camera looks at for each robot, world, m."""
    names: Sequence[str]
    orbit: Orbit
    arrows: Sequence[Arrow]
    """About the first robot."""


class ViewCamera:
    """Observer of a session that takes pictures of it."""

    def __init__(self) -> None:
        self.orbit = Orbit()

    def __call__(self, step: Step) -> None:
        """Take note of a control step, or of the start of an episode."""
        if step.number == 0:
            self.orbit = replace(self.orbit, target=tuple(step.infos["position"][0].tolist()))
            self._scene = Scene(step)
        else:
            self._scene.advance(step)

    def picture(self, session: Session) -> Picture:
        """Of now."""
        env, positions = session.env, session.latest.infos["position"]
        self.orbit = self.orbit.at(positions[0])
        height = self.orbit.target[2]
        return Picture(
            model=env.simulation.model,
            robots=[env.simulation.snapshot(robot) for robot in range(env.num_envs)],
            places=[self.orbit.target, *((float(x), float(y), height) for x, y, _ in positions[1:])],
            names=[policy.name for policy in session.policies],
            orbit=self.orbit,
            arrows=self._scene.arrows(),
        )
