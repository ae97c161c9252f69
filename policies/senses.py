"""What a legged robot feels, from its observation: attitude, velocity, turning, and where its feet are."""

from typing import NamedTuple

import numpy as np

from policies.gait import Floats
from policies.kinematics import foot_positions
from policies.level_frame import LevelFrame, Vector, level_frame
from quad_env import OBSERVATION
from quad_env.robot import HIP_POSITIONS, HOME_POSE


class Senses(NamedTuple):
    """Arrays of robots, (n, 1), and of legs, (n, 4)."""

    frame: LevelFrame
    velocity: Vector
    """Of the trunk's centre, level frame, m/s."""
    yaw_rate: Floats
    """About the vertical, rad/s."""
    roll_rate: Floats
    pitch_rate: Floats
    feet: Vector
    """From the trunk's centre, level frame, m."""


def sense(observation: Floats) -> Senses:
    """Senses of observations (n, k)."""
    frame = level_frame(observation[:, OBSERVATION["projected_gravity"]])
    velocity, turn = (columns(observation[:, OBSERVATION[name]]) for name in ("linear_velocity", "angular_velocity"))
    joints = observation[:, OBSERVATION["joint_position"]] + HOME_POSE
    x, y, z = np.moveaxis(foot_positions(joints.reshape(-1, 4, 3)) + HIP_POSITIONS, -1, 0)
    return Senses(
        frame=frame,
        velocity=frame.to_level(velocity),
        yaw_rate=frame.up_x * turn[0] + frame.up_y * turn[1] + frame.up_z * turn[2],
        roll_rate=turn[0],
        pitch_rate=turn[1],
        feet=frame.to_level((x, y, z)),
    )


def columns(rows: Floats) -> Vector:
    """Rows (n, 3) as three columns (n, 1)."""
    return rows[:, 0:1], rows[:, 1:2], rows[:, 2:3]


def length(x: Floats, y: Floats) -> Floats:
    """Of horizontal vectors."""
    size: Floats = np.sqrt(x * x + y * y)
    return size
