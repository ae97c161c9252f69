"""Command-line options that the commands `view`, `film`, `record` and `ros` have in common.

Each of these commands simulates an episode.
"""

from dataclasses import dataclass

from evaluate.commands.options import Flag
from evaluate.hardware import HardwareConfig, parse_robot_option
from evaluate.rollouts import battery
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.config import COMMAND_BOUND
from quad_env.scenarios.scenario import Scenario

Command = tuple[float, float, float]
"""Type of a velocity command: forward and left velocity in the heading frame, m/s, and yaw rate, rad/s."""


@dataclass(frozen=True, kw_only=True)
class ScenarioOptions:
    """Options of an episode without a policy: scenario, robot and seed."""

    scenario: str = "flat"
    """Scenario, optionally with a level (push:3) or a severity (push=42), or your terrain file (hill.toml)."""
    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS, or the path of an MJCF, URDF or TOML file."""
    seed: int = 0
    """Seed of the first episode, a whole number >= 0; it determines initial state, ground, pushes and commands."""

    def resolve(self) -> tuple[HardwareConfig, Scenario]:
        """Load the robot and the scenario that the options name.

        Returns:
            hardware: Settings of robot, motors, sensors and simulator.
            scenario: Scenario of the episode.

        Raises:
            UsageError: The scenario or the robot is unknown.
        """
        hardware = parse_robot_option(self.robot)
        try:
            return hardware, battery.resolve_single(self.scenario, hardware.robot_model)
        except ValueError as error:
            raise UsageError(f"--scenario: {error}") from error

    def check(self, **limits: tuple[float, float]) -> None:
        """Raise UsageError if a number in the options is outside its limits.

        Seed and velocity command are always checked.

        Args:
            **limits: Name of an option -> smallest and largest valid value.
        """
        if getattr(self, "command", None) is not None:
            limits["command"] = (-COMMAND_BOUND, COMMAND_BOUND)
        check_numbers(self, {"seed": (0, 2**63 - 1)} | limits)


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions(ScenarioOptions):
    """Options of an episode with policies: scenario, robot, seed, and permission to load policy files."""

    trust: Flag = False
    """Load policies also from .zip files of Stable-Baselines3, which can contain hidden code."""
