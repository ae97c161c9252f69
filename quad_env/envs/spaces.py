"""The spaces of the environment, made from its robot."""

import numpy as np
from gymnasium.spaces import Box

from quad_env.robots.robot import Robot
from quad_env.task.observations import ObservationTable


def observation_space(table: ObservationTable) -> "Box[np.float32]":
    """Every observation of that table."""
    return Box(-table.bound, table.bound, dtype=np.float32)


def action_space(robot: Robot) -> "Box[np.float32]":
    """Joint targets within the robot's limits, rad."""
    return Box(robot.joint_lower.astype(np.float32), robot.joint_upper.astype(np.float32), dtype=np.float32)
