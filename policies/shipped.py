"""Folders of trained policies, and of parameters that were searched for robots other than SimpleQuad."""

from pathlib import Path

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

MODELS = Path(__file__).resolve().parents[1] / "models"
"""Folder of the shipped models: a folder for each policy of SimpleQuad, and a folder for each other built-in robot."""


def models_folder(robot: Robot) -> Path:
    """Return the path of the folder with a robot's policies; for a user's robot, next to its file."""
    if robot == SIMPLE_QUAD:
        return MODELS
    return (MODELS if robot.source is None else robot.source.parent) / robot.name
