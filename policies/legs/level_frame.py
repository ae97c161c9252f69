"""The level frame: origin at the trunk's centre, x along the trunk's heading, z up; and what a robot measures in it.

It is the contract's heading frame with a vertical axis. Vectors are tuples of three arrays that broadcast, or arrays
(3, …).
"""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats
from policies.legs.kinematics import foot_positions
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot

Vector = tuple[Floats, Floats, Floats]

_NO_HEADING = 1e-6
"""Length of the horizontal part of the trunk's x axis below which it has no heading."""


class LevelFrame(NamedTuple):
    """Attitude of the trunk: the world's up direction in the base frame, each of shape (n,)."""

    up_x: Floats
    """Rise of the trunk's x axis: positive with the nose up."""
    up_y: Floats
    """Rise of the trunk's y axis: positive with the left side up."""
    up_z: Floats
    level_x: Floats
    """Length of the horizontal part of the trunk's x axis."""

    @property
    def roll(self) -> Floats:
        """Turn about +x, rad: positive with the left side up; (n,)."""
        return np.arctan2(self.up_y, self.up_z)

    @property
    def pitch(self) -> Floats:
        """Turn about +y, rad: positive with the nose down; (n,)."""
        pitch: Floats = -np.arcsin(self.up_x.clip(-1.0, 1.0))
        return pitch

    def to_level(self, vector: Vector | Floats) -> Vector:
        """A base-frame vector in the level frame.

        The level axes in the base frame are z = up, y = up × x / |up × x| and x = y × z.
        """
        x, y, z = vector
        length = self.level_x
        across, rise = self.up_y / length, self.up_z / length
        return (
            length * x - self.up_x * (across * y + rise * z),
            rise * y - across * z,
            self.up_x * x + self.up_y * y + self.up_z * z,
        )

    def to_body(self, vector: Vector) -> Vector:
        """A level-frame vector in the base frame: undoes `to_level`."""
        x, y, z = vector
        length = self.level_x
        across, rise = self.up_y / length, self.up_z / length
        return (
            length * x + self.up_x * z,
            rise * y + self.up_y * z - self.up_x * across * x,
            self.up_z * z - across * y - self.up_x * rise * x,
        )


def level_frame(projected_gravity: Floats) -> LevelFrame:
    """The frame of unit gravity vectors in the base frame, (3, n)."""
    up_x, up_y, up_z = -projected_gravity
    return LevelFrame(up_x, up_y, up_z, np.maximum(np.sqrt(up_y * up_y + up_z * up_z), _NO_HEADING))


class Senses(NamedTuple):
    """Arrays of robots, (n,), and of legs, (4, n)."""

    frame: LevelFrame
    velocity: Vector
    """Velocity of the trunk's centre, level frame, m/s."""
    yaw_rate: Floats
    """About the vertical, rad/s."""
    roll_rate: Floats
    pitch_rate: Floats
    feet: Vector
    """From the trunk's centre, level frame, m."""


def sense(robot: Robot, observation: Floats) -> Senses:
    """Senses of observations (k, n)."""
    frame, velocity, yaw_rate = motion(observation)
    roll_rate, pitch_rate, _ = observation[OBSERVATION["angular_velocity"]]
    joints = (observation[OBSERVATION["joint_position"]] + robot.home_pose[:, None]).reshape(len(robot.side), 3, -1)
    x, y, z = np.moveaxis(foot_positions(robot, np.moveaxis(joints, 1, -1), legs_first=True), -1, 0)
    hip_x, hip_y = hips(robot)
    return Senses(
        frame=frame,
        velocity=velocity,
        yaw_rate=yaw_rate,
        roll_rate=roll_rate,
        pitch_rate=pitch_rate,
        feet=frame.to_level((x + hip_x, y + hip_y, z)),
    )


def motion(observation: Floats) -> tuple[LevelFrame, Vector, Floats]:
    """Attitude, velocity of the trunk's centre in the level frame, m/s, and yaw rate about the vertical, rad/s, of
    observations (k, n)."""
    frame = level_frame(observation[OBSERVATION["projected_gravity"]])
    velocity, turn = (observation[OBSERVATION[name]] for name in ("linear_velocity", "angular_velocity"))
    return frame, frame.to_level(velocity), frame.up_x * turn[0] + frame.up_y * turn[1] + frame.up_z * turn[2]


def hips(robot: Robot) -> tuple[Floats, Floats]:
    """Hip joints from the trunk's centre, forward and to the left, (4, 1) each, m."""
    return robot.hip_positions[:, 0:1], robot.hip_positions[:, 1:2]


def length(x: Floats, y: Floats) -> Floats:
    """Lengths of horizontal vectors."""
    return np.sqrt(x * x + y * y)
