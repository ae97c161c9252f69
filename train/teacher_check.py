"""Check that a controller walks on a robot before a network learns from it.

If the controller does not walk, the check changes one limit of the robot after the other in simulation (joint torque,
servo gains, speed of the commands), and names the changes with which the controller walks.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

from evaluate.hardware import HardwareConfig
from policies.base import PolicyError
from quad_env.cli.command_line import UsageError
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scaled_servo_gains
from train.config import ValidationConfig
from train.validation import validate

EPISODES = 8
"""Number of validation episodes on flat ground in the check."""
MIN_SUCCESS = 0.75
"""Smallest success rate at which a controller counts as walking, so that a network can learn from it, 0 to 1."""
TORQUE_FACTOR = 2.5
"""Factor on the joint torque limit in the test whether a small torque limit is the reason of a failure."""
FLAT = "flat"
SLOW = "slow"
"""Scenario with slow commands, scaled to the size of the robot."""


@dataclass(frozen=True)
class _ModifiedHardware(HardwareConfig):
    """Hardware configuration with a `Robot` object in place of a name, because a changed robot has no name."""

    modified_robot: Robot | None = None
    """Robot of the configuration; None for the robot with the name `robot`."""

    @property
    def robot_model(self) -> Robot:
        """Robot of the configuration."""
        return self.modified_robot or super().robot_model


class RobotChange(NamedTuple):
    """Possible reason why a controller does not walk, and the change of robot or commands that removes the reason."""

    change: str
    """The change as text that completes the sentence "It walks with …"."""
    robot: Robot
    """Robot after the change."""
    scenario: str = FLAT
    """Name of the scenario after the change."""


def check_walking(teacher: str, hardware: HardwareConfig, threads: int = 1) -> float:
    """Check that a controller walks on flat ground.

    Args:
        teacher: Name or path of the controller.
        hardware: Robot and servo gains.
        threads: Number of threads of the simulation.

    Returns:
        Success rate on the validation episodes.

    Raises:
        UsageError: The controller cannot control the robot, or its success rate is below MIN_SUCCESS. The message is
            one line with the changes of the robot or of the commands with which the controller walks.
    """
    success = _success_rate(teacher, hardware, FLAT, threads)
    if success >= MIN_SUCCESS:
        return success
    robot = hardware.policy(teacher).robot
    single, combination = _suspects(robot)
    helpful = [suspect.change for suspect in single if _helps(teacher, hardware, suspect, threads)]
    if not helpful and _helps(teacher, hardware, combination, threads):
        helpful = [combination.change]
    fact = f"{teacher} does not walk on {robot.name}: {round(success * EPISODES)} of {EPISODES} episodes succeed"
    reason = f"it walks with {', or with '.join(helpful)}" if helpful else _unexplained(robot)
    raise UsageError(f"{fact}; {reason}; correct the robot's values, or take --learner residual")


def _success_rate(teacher: str, hardware: HardwareConfig, scenario: str, threads: int) -> float:
    """Return the success rate of a controller on the validation episodes of one scenario.

    Args:
        teacher: Name or path of the controller.
        hardware: Robot and servo gains.
        scenario: Name of the scenario.
        threads: Number of threads of the simulation.

    Returns:
        Success rate, 0 to 1.

    Raises:
        UsageError: The controller cannot control the robot.
    """
    config = ValidationConfig(episodes=EPISODES, scenarios=(scenario,))
    try:
        policy = hardware.policy(teacher)
    except PolicyError as error:
        raise UsageError(f"--teacher: {error}") from None
    return validate(policy, config, threads, hardware)[scenario]["success_rate"]


def _helps(teacher: str, hardware: HardwareConfig, suspect: RobotChange, threads: int) -> bool:
    """Return True if the controller walks after the change that removes one possible reason of the failure.

    Args:
        teacher: Name or path of the controller.
        hardware: Robot and servo gains before the change.
        suspect: Possible reason, with the change of the robot or of the commands that removes the reason.
        threads: Number of threads of the simulation.

    Returns:
        True if the success rate is at least MIN_SUCCESS.
    """
    changed = _ModifiedHardware(robot=hardware.robot, modified_robot=suspect.robot)
    return _success_rate(teacher, changed, suspect.scenario, threads) >= MIN_SUCCESS


def _suspects(robot: Robot) -> tuple[list[RobotChange], RobotChange]:
    """Return the possible reasons why a controller does not walk with a robot.

    Args:
        robot: The robot.

    Returns:
        single: Changes of one limit each.
        combination: Change of joint torque and servo gains together.
    """
    torque = TORQUE_FACTOR * robot.rated_torque
    stiffness, damping = (float(f"{gain:.3g}") for gain in scaled_servo_gains(robot))
    strong = replace(robot, rated_torque=torque)
    torque_text = f"joint torques of {torque:.3g} instead of {robot.rated_torque:.3g} N·m"
    servo_text = f"servos of {stiffness:g} N·m/rad and {damping:g} N·m·s/rad instead of {robot.servo}"
    single = [
        RobotChange(torque_text, strong),
        RobotChange(servo_text, robot.with_servo(stiffness, damping)),
        RobotChange("slower commands", robot, SLOW),
    ]
    return single, RobotChange(f"{torque_text} and {servo_text}", strong.with_servo(stiffness, damping))


def _unexplained(robot: Robot) -> str:
    """Return text about a failure that no tested change removes.

    The text has the joint torque limit of the robot as a fraction of weight x leg length.
    """
    return (
        "neither larger joint torques, nor stiffer servos, nor slower commands help (the joint torque is "
        f"{_relative_torque(robot):.2f} of weight x leg length); python -m quad_env doctor checks masses and home pose"
    )


def _relative_torque(robot: Robot) -> float:
    """Return the joint torque limit of a robot as a fraction of its weight times its leg length."""
    return robot.rated_torque / (robot.mass * GRAVITY * robot.leg_length)
