"""What there is to see: the robots, the ghost of the command, arrows, footholds, and where the camera is."""

from collections import deque
from dataclasses import replace

import numpy as np

from evaluate.film.scene import Scene
from evaluate.rollouts.observers import Step
from live.session import Session
from live.view.orbit import Orbit
from live.view.painter import Picture
from quad_env.physics.marks import Ball, Colour, Ghost, Mark
from quad_env.robots.similarity import scaled

FOOTHOLDS = 24
"""Footholds of the first robot that stay to be seen."""
_FOOTHOLD: Colour = (0.2, 0.45, 0.95, 0.8)
_FOOTHOLD_RADIUS = 0.022
"""m, of SimpleQuad."""
_THREAD = 2
"""Marks of the ghost, which come first: itself and the thread to it."""


class Sight:
    """Observer of a session from which pictures are taken."""

    def __init__(self) -> None:
        self.orbit = Orbit()
        self.together = False
        """All robots in one picture."""
        self.forces = False
        """Forces of the first robot's contacts."""
        self.ghost = True
        """Where the first robot would be had it followed the command exactly since that was given."""
        self._footholds: deque[Ball] = deque(maxlen=FOOTHOLDS)
        self._command, self._touching = np.zeros(3), np.zeros(0, bool)

    def __call__(self, step: Step) -> None:
        """Take note of a control step, or of the start of an episode."""
        command, touching = step.infos["command"][0], step.infos["foot_contact"][0]
        if step.number == 0:
            self._footholds.clear()
            self._scene = Scene(step)
            self.orbit = self.orbit.beside(step.infos["position"][0])
        elif not np.array_equal(command, self._command):
            self._scene = Scene(step)
        else:
            self._scene.advance(step)
        if step.number:
            radius = scaled(step.env.robot, _FOOTHOLD_RADIUS, "m")
            for place in step.infos["foot_position"][0][touching & ~self._touching]:
                self._footholds.append(Ball(tuple(place.tolist()), radius, _FOOTHOLD))
        self._command, self._touching = command.copy(), touching.copy()

    def picture(self, session: Session) -> Picture:
        """Of now."""
        env, positions = session.env, session.latest.infos["position"]
        self.orbit = self.orbit.at(positions[0])
        marks: list[Mark] = list(self._scene.marks())
        if not self.ghost:
            marks = [mark for mark in marks[_THREAD:] if not isinstance(mark, Ghost)]
        height = self.orbit.target[2]
        return Picture(
            model=env.simulation.model,
            robots=[env.simulation.snapshot(robot) for robot in range(env.num_envs)],
            places=[self.orbit.target, *((float(x), float(y), height) for x, y, _ in positions[1:])],
            names=[policy.name for policy in session.policies],
            orbit=self.orbit,
            marks=[*self._footholds, *marks],
            together=self.together,
            forces=self.forces,
        )

    def follow(self, on: bool) -> None:
        """Have the camera go along with the robots, or stay."""
        self.orbit = replace(self.orbit, follow=on)
