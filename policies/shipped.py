"""Where trained policies lie, and the parameters that were found for robots other than SimpleQuad."""

from pathlib import Path

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

MODELS = Path(__file__).resolve().parents[1] / "models"
"""What ships with the project: SimpleQuad's, each policy in a folder with its name, and those of robots that have a
name, in a folder a robot."""


def models_folder(robot: Robot) -> Path:
    """Folder of what was found for a robot: one of its name, next to the file of a user's robot."""
    if robot == SIMPLE_QUAD:
        return MODELS
    return (MODELS if robot.source is None else robot.source.parent) / robot.name
