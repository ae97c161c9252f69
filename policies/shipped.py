"""Folders with the trained policies of each robot, and with searched parameters for robots other than SimpleQuad."""

from pathlib import Path

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

MODELS = Path(__file__).resolve().parents[1] / "models"
"""Path of the folder `models`, which ships with the project.

It has a subfolder for each trained policy of SimpleQuad, and a subfolder for each other built-in robot."""


def models_folder(robot: Robot) -> Path:
    """Return the path of the models folder of a robot: its trained policies and searched parameters.

    For a robot of a user, the folder has the name of the robot and is next to the file of the robot.
    """
    if robot == SIMPLE_QUAD:
        return MODELS
    return (MODELS if robot.source is None else robot.source.parent) / robot.name
