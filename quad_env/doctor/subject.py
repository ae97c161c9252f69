"""The robot, and perhaps the policy, that a run of checks examines."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quad_env.robots.named import ROBOTS, SUFFIXES, robot_of

if TYPE_CHECKING:
    from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class Subject:
    """Robot and policy."""

    given: "str | Robot" = "simple_quad"
    """Name of a robot, path of its MJCF or TOML, or the robot itself."""
    policy: str | None = None
    """Policy by name or path."""

    def __post_init__(self) -> None:
        """Raises ValueError, one line, for a robot that is neither a name nor a file."""
        given = self.given
        if isinstance(given, str) and given not in ROBOTS:
            if Path(given).suffix not in SUFFIXES:
                robot_of(given)  # raises: unknown robot …
            if not Path(given).is_file():
                raise ValueError(f"{given} is no file")

    @property
    def name(self) -> str:
        """Name of the robot, or the path of its file."""
        return self.given if isinstance(self.given, str) else str(self.given.source or self.given.name)

    @cached_property
    def robot(self) -> "Robot":
        """The robot. Raises what reading it does."""
        return robot_of(self.given)

    @cached_property
    def env(self) -> Any:
        """A single environment with it, falls ignored. Raises ValueError where there is none."""
        from quad_env.envs.env import SimpleQuadEnv

        return SimpleQuadEnv(robot=self.robot, terminate_on_fall=False)

    @property
    def figures(self) -> str:
        """Place where the figures of the robot can be given, in words."""
        if self.name.endswith(".toml"):
            return self.name
        return f"a TOML (python -m quad_env describe {self.name} --toml mine.toml)"
