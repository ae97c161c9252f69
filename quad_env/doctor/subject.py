"""What is examined: a robot, perhaps a policy, and the folder that one works in."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quad_env.robots.named import ROBOTS, SUFFIXES, robot_of

if TYPE_CHECKING:
    from quad_env.doctor.stand import Stand
    from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class Subject:
    """What a run of checks is about."""

    told: "str | Robot" = "simple_quad"
    """Name of a robot, path of its MJCF or TOML, or the robot itself."""
    policy: str | None = None
    """Policy by name or path; None for none of one's own."""
    folder: Path = field(default_factory=Path)
    """Where results are to be written."""

    def __post_init__(self) -> None:
        """Raises ValueError, one line, for a robot that is neither a name nor a file."""
        told = self.told
        if isinstance(told, str) and told not in ROBOTS:
            if Path(told).suffix not in SUFFIXES:
                robot_of(told)  # raises: unknown robot …
            if not Path(told).is_file():
                raise ValueError(f"{told} is no file")

    @cached_property
    def robot(self) -> "Robot":
        """The robot. Raises what reading it does."""
        return robot_of(self.told)

    @cached_property
    def env(self) -> Any:
        """A single environment with it, falls ignored. Raises ValueError where there is none."""
        from quad_env.envs.env import SimpleQuadEnv

        return SimpleQuadEnv(robot=self.robot, terminate_on_fall=False)

    @cached_property
    def stand(self) -> "Stand":
        """What comes of holding the home pose."""
        from quad_env.doctor.stand import stand

        return stand(self.env)

    @property
    def figures(self) -> str:
        """Where the figures of the robot can be told, in words."""
        if isinstance(self.told, str) and self.told.endswith(".toml"):
            return self.told
        name = self.told if isinstance(self.told, str) else self.told.name
        return f"a TOML (python -m quad_env describe {name} --toml mine.toml)"
