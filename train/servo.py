"""Describes the servo gains of a training run, and compares them with the gains of an earlier policy.

With other gains, a trained network would move the robot differently. A run therefore refuses to continue with other
gains than the network was trained with.
"""

import numpy as np

import policies
from policies.base import Policy
from quad_env.cli.command_line import UsageError
from quad_env.robots.robot import STIFF, Robot
from train.config import TrainConfig
from train.run_folder import LAST
from train.training_robots import make_base


def describe_servo(config: TrainConfig) -> str:
    """Return a line with the servo gains of a training run and their source: --servo, base policy or robot."""
    robot = config.hardware.robot_model
    base = make_base(config)
    source = f"{base.name}'s"
    if config.servo:
        source = f"--servo {config.servo}"
    elif base.robot.has_gains(robot.gains):
        source = f"{robot.name}'s own"
    return f"servos: {base.robot.servo} ({source})"


def check_start_servo(config: TrainConfig, start: Policy) -> None:
    """Check that a policy, with which a training run starts, has the servo gains of the run.

    Args:
        config: Settings of the run.
        start: Policy of the option `--start`.

    Raises:
        ValueError: The policy has other gains. The message names the option that gives the run these gains.
    """
    robot = make_base(config).robot
    if not start.robot.has_gains(robot.gains):
        option = _servo_option(start.robot)
        remedy = f"; give --servo {option}" if option else ""
        raise ValueError(f"{config.start} has servos of {start.robot.servo}, this run of {robot.servo}{remedy}")


def check_resumed_servo(config: TrainConfig) -> None:
    """Check that a continued run has the servo gains with which it began.

    End-to-end runs of earlier versions had the stiff servos of their base policy, a fixed pose. A run without a
    readable bundle is not checked.

    Args:
        config: Settings of the run.

    Raises:
        UsageError: The last bundle of the run has other gains. The message says how to train its network further.
    """
    robot = make_base(config).robot
    try:
        begun = policies.load(config.folder / LAST, robot, servo="own")
    except policies.PolicyError:
        return
    if not begun.robot.has_gains(robot.gains):
        option = _servo_option(begun.robot)
        remedy = f"begin another run with --start {config.folder}{f' --servo {option}' if option else ''}"
        fact = f"--resume: the run has servos of {begun.robot.servo}, this version trains it on {robot.servo}"
        raise UsageError(f"{fact}; {remedy}")


def _servo_option(robot: Robot) -> str:
    """Return the value of the option `--servo` that gives a run the servo gains of a robot.

    The text is empty if the joints have different gains, because the option sets the same gains for all joints.
    """
    if robot.has_gains(robot.stiff_servo):
        return STIFF
    if np.ptp(robot.gains, axis=1).any():
        return ""
    stiffness, damping = robot.gains[:, 0].tolist()
    return f"{stiffness}/{damping}"
