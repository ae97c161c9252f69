"""Folders that ship with the project: trained policies, and searched parameters for several robots."""

from pathlib import Path

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

_ROOT = Path(__file__).resolve().parents[1]
_INSTALLED_MODELS = _ROOT / "simple_quad_bench" / "models"
MODELS = _INSTALLED_MODELS if _INSTALLED_MODELS.is_dir() else _ROOT / "models"
"""Path of the folder `models`, which ships with the project; the distribution has it in `simple_quad_bench`.

The folder has a subfolder for each trained policy of SimpleQuad. For each other built-in robot, it has a subfolder with
the trained policies and the searched parameters of this robot."""


def models_folder(robot: Robot) -> Path:
    """Return the path of the folder with the trained policies and searched parameters of a `robot`.

    A robot that a user has defined has its own file. The folder is next to this file, and has the name of the robot.
    """
    if robot == SIMPLE_QUAD:
        return MODELS
    return (MODELS if robot.source is None else robot.source.parent) / robot.name
