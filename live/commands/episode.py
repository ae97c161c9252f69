"""The episode that a command shows, films, records or offers: options that several commands share."""

from dataclasses import dataclass

import numpy as np

from evaluate.commands.options import Flag
from evaluate.rollouts import battery
from evaluate.rollouts.hardware import Hardware, hardware_of
from quad_env.cli.command_line import UsageError
from quad_env.config import COMMAND_BOUND
from quad_env.scenarios.scenario import Scenario

Command = tuple[float, float, float]
"""Forward m/s, left m/s, yaw rate rad/s."""


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """Scenario, robot and seed of an episode."""

    scenario: str = "flat"
    """Scenario, also with a level or severity: push:3, push=42."""
    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS, or the path of its MJCF or TOML."""
    seed: int = 0
    """Seed of the first episode (whole number from 0)."""
    trust: Flag = False
    """Load policies from files in which code can be hidden, the .zip files of Stable-Baselines3."""

    def resolve(self) -> tuple[Hardware, Scenario]:
        """The robot's hardware and its scenario. Raises UsageError where one of them does not exist."""
        hardware = hardware_of(self.robot)
        try:
            return hardware, battery.one(self.scenario, hardware.quadruped)
        except ValueError as error:
            raise UsageError(f"--scenario: {error}") from error


def check_command(command: Command | None) -> None:
    """Raise UsageError for a command that is out of range."""
    if command is not None and not (np.abs(command) <= COMMAND_BOUND).all():
        raise UsageError(f"--command must be three numbers within ±{COMMAND_BOUND:g}, not {command}")
