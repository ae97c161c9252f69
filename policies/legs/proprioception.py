"""What a legged robot measures of itself, from its observation: attitude, velocity, turning, and where its feet are."""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats
from policies.legs.kinematics import foot_positions
from policies.legs.level_frame import LevelFrame, Vector, level_frame, vector
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot


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
    velocity, turn = (vector(observation[OBSERVATION[name]]) for name in ("linear_velocity", "angular_velocity"))
    return frame, frame.to_level(velocity), frame.up_x * turn[0] + frame.up_y * turn[1] + frame.up_z * turn[2]


def hips(robot: Robot) -> tuple[Floats, Floats]:
    """Hip joints from the trunk's centre, forward and to the left, (4, 1) each, m."""
    return robot.hip_positions[:, 0:1], robot.hip_positions[:, 1:2]


def length(x: Floats, y: Floats) -> Floats:
    """Lengths of horizontal vectors."""
    return np.sqrt(x * x + y * y)
