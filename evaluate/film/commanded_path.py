"""Place of an ideal robot that follows its commands exactly."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from evaluate.rollouts.observers import Step
from quad_env.columns import Array, Vector, of_robots
from quad_env.physics.marks import Colour, Ghost
from quad_env.physics.state import rotation_matrix
from quad_env.robots.kinematics import feet_in_world
from quad_env.robots.robot import Robot
from quad_env.scenarios.terrain import Terrain


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


def _upon(yaw: float, rise_forward: float, rise_left: float) -> Array:
    """Rotation of a base that faces that way on ground which rises so, m/m, in its heading frame, (3, 3)."""
    forward = np.array([1.0, 0.0, rise_forward]) / math.hypot(1.0, rise_forward)
    up = np.array([-rise_forward, -rise_left, 1.0]) / math.hypot(1.0, rise_forward, rise_left)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([(cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)])
    return turn @ np.column_stack([forward, np.cross(up, forward), up])
