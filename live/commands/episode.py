"""The episode that options name: checks that commands share."""

import numpy as np

from evaluate.rollouts import battery
from evaluate.rollouts.hardware import Hardware
from quad_env.cli.command_line import UsageError
from quad_env.config import COMMAND_BOUND
from quad_env.scenarios.scenario import Scenario

Command = tuple[float, float, float]
"""Forward m/s, left m/s, yaw rate rad/s."""


def check_command(command: Command | None) -> None:
    """Raise UsageError for one that no robot is ever given."""
    if command is not None and not (np.abs(command) <= COMMAND_BOUND).all():
        raise UsageError(f"--command must be three numbers within ±{COMMAND_BOUND:g}, not {command}")


def one_scenario(name: str, hardware: Hardware) -> Scenario:
    """The robot's scenario of that name. Raises UsageError where there is none, or several."""
    try:
        return battery.one(name, hardware.quadruped)
    except ValueError as error:
        raise UsageError(f"--scenario: {error}") from error
