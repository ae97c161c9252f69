"""Marks in the frames of a film: arrows for velocity, command and push, and balls at the feet."""

import math
from collections import deque

import numpy as np

from evaluate.rollouts.observers import Step
from quad_env.columns import Array, to_components
from quad_env.config import GRAVITY
from quad_env.physics.arrows import Arrow, Ball, Colour
from quad_env.physics.state import rotation_matrix
from quad_env.robots.similarity import scale_to_robot

COMMAND: Colour = (0.25, 0.95, 0.35, 1.0)
"""Colour of the arrow that shows the commanded velocity: red, green, blue, opacity, 0 … 1."""
VELOCITY: Colour = (1.0, 0.8, 0.1, 1.0)
"""Colour of the arrow that shows the robot's velocity: red, green, blue, opacity, 0 … 1."""
PUSH: Colour = (0.9, 0.15, 0.15, 1.0)
"""Colour of the arrow that shows a push: red, green, blue, opacity, 0 … 1."""
CONTACT: Colour = (0.1, 0.6, 1.0, 1.0)
"""Colour of the ball at a foot in contact with the ground: red, green, blue, opacity, 0 … 1."""
SWING: Colour = (1.0, 1.0, 1.0, 1.0)
"""Colour of the ball at a swing foot: red, green, blue, opacity, 0 … 1."""
VELOCITY_WINDOW = 0.5
"""Time over which the displayed velocity of the robot is averaged, s.

The mean removes the oscillation of the trunk within a stride of a trot.
"""
PUSH_DISPLAY_TIME = 0.2
"""Time for which the arrow of a push stays in the film after the push, s.

Without this time a viewer would not notice the arrow, because a push is short.
"""
AHEAD = 0.5
"""Length of a velocity arrow for a velocity of 1 m/s, m.

The value is valid for the robot SimpleQuad, and is scaled to the size of other robots.
"""
_FORCE = 0.2
"""Length of the arrow of a push with a force equal to the robot's weight, m.

The value is valid for the robot SimpleQuad, and is scaled to the size of other robots.
"""
_RADIUS = 0.018
"""Radius of the shaft of an arrow, for the robot SimpleQuad, m."""
_ABOVE = 0.22
"""Height of the command arrow above the top of the trunk or payload, for the robot SimpleQuad, m."""
_FOOT = 0.03
"""Minimum radius of the balls at the feet, for the robot SimpleQuad, m."""


def heading_angles(step: Step) -> Array:
    """Return the yaw angle of the heading frame of every robot in the world frame, (n,), rad."""
    rotation = rotation_matrix(to_components(step.infos["quaternion"]))
    return np.arctan2(rotation[1][0], rotation[0][0])


def heading_angle(step: Step) -> float:
    """Return the yaw angle of the heading frame of the first robot in the world frame, rad."""
    return float(heading_angles(step)[0])


class Scene:
    """Arrows and balls that mark the first simulated robot in a film, updated at every control step."""

    def __init__(self, start: Step) -> None:
        self._velocities: deque[Array] = deque(maxlen=max(1, round(VELOCITY_WINDOW / start.env.dt)))
        self._push = np.zeros(2)  # Force of the latest push, world frame, x and y, N.
        self._push_until = 0  # Number of the control step at which the arrow of the push disappears.
        self.step = start
        """Latest control step that the marks show."""

    def advance(self, step: Step) -> None:
        """Update the marks to the state of the robot after a control `step`."""
        self.step = step
        self._velocities.append(step.infos["heading_velocity"][0].copy())
        push = step.infos["push"][0]
        if push.any():
            self._push = push.copy()
            self._push_until = step.number + round(PUSH_DISPLAY_TIME / step.env.dt)

    @property
    def velocity(self) -> Array:
        """Displayed velocity: forward and leftward velocity, m/s, and yaw rate, rad/s, heading frame, (3,).

        It is the mean over the latest period of VELOCITY_WINDOW.
        """
        return np.mean(self._velocities, axis=0) if self._velocities else np.zeros(3)

    @property
    def is_push_shown(self) -> bool:
        """True if the arrow of a push is displayed at the current control step."""
        return self.step.number < self._push_until

    def marks(self) -> list[Arrow | Ball]:
        """Return all marks of a frame: the arrows, and a ball at each foot.

        The ball is blue if the foot touches the ground, and white during its swing phase. The label of each ball is the
        name of its leg.
        """
        infos = self.step.infos
        robot = self.step.env.robot
        radius = max(scale_to_robot(robot, _FOOT, "m"), 1.1 * robot.foot_radius)
        feet = zip(infos["foot_position"][0].tolist(), infos["foot_contact"][0], robot.leg_names, strict=True)
        balls = [
            Ball(tuple(position), radius, CONTACT if in_contact else SWING, leg.upper())
            for position, in_contact, leg in feet
        ]
        return [*self.arrows(), *balls]

    def arrows(self) -> list[Arrow]:
        """Return the arrows that show the commanded velocity, the robot's velocity, and a recent push."""
        robot = self.step.env.robot
        trunk = self.step.infos["position"][0]
        payload = self.step.env.scenario.payload
        payload_height = 0.0 if payload is None else payload.edge
        height = scale_to_robot(robot, _ABOVE, "m") + robot.trunk_size[2] / 2 + payload_height
        velocity_height = height + scale_to_robot(robot, 3.0 * _RADIUS, "m")
        arrows = [
            self._velocity_arrow(trunk, self.step.infos["command"][0], COMMAND, height),
            self._velocity_arrow(trunk, self.velocity, VELOCITY, velocity_height),
        ]
        if self.is_push_shown:
            weights = self._push / (robot.mass * GRAVITY)
            displacement = scale_to_robot(robot, _FORCE, "m") * np.array([*weights, 0.0])
            arrows.append(self._arrow(trunk, displacement, PUSH, 1.5))
        return arrows

    def _velocity_arrow(self, trunk: Array, velocity: Array, colour: Colour, height: float) -> Arrow:
        """Return the arrow that shows a velocity above the trunk.

        Args:
            trunk: Trunk position, world frame, (3,), m.
            velocity: Forward and leftward velocity, heading frame, m/s, and yaw rate (not drawn), rad/s, (3,).
            colour: Colour of the arrow.
            height: Height of the arrow above the trunk position, m.

        Returns:
            The arrow.
        """
        forward, left, _ = velocity
        yaw = heading_angle(self.step)
        cos = math.cos(yaw)
        sin = math.sin(yaw)
        length = scale_to_robot(self.step.env.robot, AHEAD, "s")
        displacement = length * np.array([cos * forward - sin * left, sin * forward + cos * left, 0.0])
        return self._arrow(trunk + np.array([0.0, 0.0, height]), displacement, colour)

    def _arrow(self, start: Array, displacement: Array, colour: Colour, thickness: float = 1.0) -> Arrow:
        """Return an arrow between two points of the world frame.

        Args:
            start: Start point, world frame, (3,), m.
            displacement: Vector from the start point to the tip, world frame, (3,), m.
            colour: Colour of the arrow.
            thickness: Factor on the default radius of the shaft, dimensionless.

        Returns:
            The arrow.
        """
        radius = thickness * scale_to_robot(self.step.env.robot, _RADIUS, "m")
        return Arrow(tuple(start.tolist()), tuple((start + displacement).tolist()), radius, colour)
