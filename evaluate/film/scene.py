"""What is drawn into the frames of an episode: a ghost that follows its commands exactly, and arrows at the trunk."""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from evaluate.rollouts.observers import Step
from quad_env.columns import Array, Vector, of_robots
from quad_env.config import GRAVITY
from quad_env.physics.marks import Arrow, Colour, Ghost, Mark
from quad_env.physics.state import rotation_matrix
from quad_env.robots.kinematics import feet_in_world
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scaled
from quad_env.scenarios.terrain import Terrain

COMMAND: Colour = (0.25, 0.95, 0.35, 1.0)
VELOCITY: Colour = (1.0, 0.8, 0.1, 1.0)
PUSH: Colour = (0.9, 0.15, 0.15, 1.0)
GHOST: Colour = (0.2, 0.85, 1.0, 0.35)
THREAD: Colour = (0.2, 0.85, 1.0, 0.6)
MEAN_OVER = 0.5
"""Time over which the velocity that is shown is a mean, s: a trot sways within a stride."""
PUSH_LINGERS = 0.2
"""s for which a push is marked longer than it is on, since it is shorter than the eye needs."""
AHEAD = 0.5
"""s of way that an arrow of a velocity is long, on SimpleQuad."""
_FORCE = 0.2
"""m for each of its own weights that an arrow of a push is long, on SimpleQuad."""
_RADIUS, _ABOVE = 0.018, 0.22
"""Of the arrows and between them and the trunk, m, on SimpleQuad."""


@dataclass(frozen=True)
class CommandedPath:
    """A place on the ground, world frame, m, and a heading there, rad; commands lead from place to place.

    It begins where the robot's episode does, and knows nothing of the robot from then on.
    """

    x: float
    y: float
    yaw: float

    @classmethod
    def of(cls, start: Step) -> Self:
        """Where the first robot is, and faces, at the start of its episode."""
        x, y = start.infos["position"][0, :2].tolist()
        return cls(x, y, heading(start))

    def after(self, command: Vector[float], time: float) -> Self:
        """Where a command, forward and left, m/s, heading frame, and yaw rate, rad/s, leads to in that time, s.

        At a constant yaw rate the way is an arc of the angle w·t. Its chord is shorter than the arc by
        sin(w·t/2)/(w·t/2), and points half the angle away from the heading at its beginning.
        """
        forward, left, yaw_rate = (float(value) * time for value in command)
        chord, along = float(np.sinc(yaw_rate / (2.0 * math.pi))), self.yaw + 0.5 * yaw_rate
        cos, sin = chord * math.cos(along), chord * math.sin(along)
        return replace(
            self,
            x=self.x + cos * forward - sin * left,
            y=self.y + sin * forward + cos * left,
            yaw=self.yaw + yaw_rate,
        )

    def ghost(self, robot: Robot, terrain: Terrain, colour: Colour) -> Ghost:
        """The robot standing there, along the plane that fits the ground below its feet best, on its highest one."""
        feet = feet_in_world(robot, np.zeros((1, 3)), np.eye(3)[None], robot.home_pose[None])[0]
        level = feet @ _upon(self.yaw, 0.0, 0.0).T
        ground = terrain.height(self.x + level[:, 0], self.y + level[:, 1])
        (ahead, left, _), *_ = np.linalg.lstsq(np.column_stack([feet[:, :2], np.ones(len(feet))]), ground)
        rotation = _upon(self.yaw, ahead, left)
        x, y, z = rotation @ feet.T
        lift = float((terrain.ball_height(self.x + x, self.y + y, robot.foot_radius) - z).max())
        return Ghost((self.x, self.y, lift), rotation, colour)


def headings(step: Step) -> Array:
    """Yaw of every robot's heading frame in the world, rad, (n,)."""
    rotation = rotation_matrix(of_robots(step.infos["quaternion"]))
    return np.arctan2(rotation[1][0], rotation[0][0])


def heading(step: Step) -> float:
    """Yaw of the first robot's heading frame in the world, rad."""
    return float(headings(step)[0])


class Scene:
    """The first robot's marks, step by step."""

    def __init__(self, start: Step) -> None:
        self.path = CommandedPath.of(start)
        self._velocities: deque[Array] = deque(maxlen=max(1, round(MEAN_OVER / start.env.dt)))
        self._push = np.zeros(2)  # N, world frame, the latest
        self._push_until = 0
        self._step = start

    def advance(self, step: Step) -> None:
        """Take note of a control step."""
        self._step = step
        self.path = self.path.after(step.infos["command"][0], step.env.dt)
        self._velocities.append(step.infos["heading_velocity"][0].copy())
        push = step.infos["push"][0]
        if push.any():
            self._push, self._push_until = push.copy(), step.number + round(PUSH_LINGERS / step.env.dt)

    @property
    def velocity(self) -> Array:
        """Forward and left, m/s, heading frame, and yaw rate, rad/s, mean of the last MEAN_OVER s, (3,)."""
        return np.mean(self._velocities, axis=0) if self._velocities else np.zeros(3)

    @property
    def pushed(self) -> bool:
        """Whether a push is to be seen."""
        return self._step.number < self._push_until

    @property
    def way_to_ghost(self) -> float:
        """Distance between the trunk and its ghost's, on the ground, m."""
        x, y = self._step.infos["position"][0, :2]
        return float(np.hypot(self.path.x - x, self.path.y - y))

    def marks(self) -> list[Mark]:
        """The ghost and a thread to it, arrows of the command and of the velocity, and of a push."""
        env, robot = self._step.env, self._step.env.robot
        trunk, terrain = self._step.infos["position"][0], env.scenario.terrain
        ghost = self.path.ghost(robot, terrain, GHOST)
        payload = env.scenario.payload
        above = scaled(robot, _ABOVE, "m") + robot.trunk_size[2] / 2 + (0.0 if payload is None else payload.edge)
        yaw = heading(self._step)
        ahead, cos, sin = scaled(robot, AHEAD, "s"), math.cos(yaw), math.sin(yaw)
        found: list[Mark] = [ghost, self._arrow(trunk, np.array(ghost.position) - trunk, THREAD, 0.3)]
        for (forward, left, _), colour, lift in (
            (self._step.infos["command"][0], COMMAND, above),
            (self.velocity, VELOCITY, above + scaled(robot, 3.0 * _RADIUS, "m")),
        ):
            way = ahead * np.array([cos * forward - sin * left, sin * forward + cos * left, 0.0])
            found.append(self._arrow(trunk + np.array([0.0, 0.0, lift]), way, colour))
        if self.pushed:
            weights = self._push / (robot.mass * GRAVITY)
            found.append(self._arrow(trunk, scaled(robot, _FORCE, "m") * np.array([*weights, 0.0]), PUSH, 1.5))
        return found

    def _arrow(self, start: Array, way: Array, colour: Colour, thickness: float = 1.0) -> Arrow:
        radius = thickness * scaled(self._step.env.robot, _RADIUS, "m")
        return Arrow(tuple(start.tolist()), tuple((start + way).tolist()), radius, colour)


def _upon(yaw: float, rise_forward: float, rise_left: float) -> Array:
    """Rotation of a base that faces that way on ground which rises so, m/m, in its heading frame, (3, 3)."""
    forward = np.array([1.0, 0.0, rise_forward]) / math.hypot(1.0, rise_forward)
    up = np.array([-rise_forward, -rise_left, 1.0]) / math.hypot(1.0, rise_forward, rise_left)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([(cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)])
    return turn @ np.column_stack([forward, np.cross(up, forward), up])
