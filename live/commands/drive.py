"""Drive a robot with a policy over Unitree's SDK2 interface: stand up, walk, and damp on danger or Ctrl-C."""

import time
from dataclasses import dataclass

import numpy as np

from evaluate.commands.options import Flag
from evaluate.hardware import parse_robot_option
from live.commands.episode import Command
from live.commands.network import NetworkOptions
from live.unitree.deployment import DeployedPolicy
from live.unitree.driver import DAMPING_TIME, Driver, Stopped
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.interrupt import Interrupt
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.config import COMMAND_BOUND

POLL_PERIOD = 0.0005
"""Time between two looks for new messages, s."""


@dataclass(frozen=True, kw_only=True)
class DriveOptions(NetworkOptions):
    """Options of the command `drive`, which drives a simulated or real robot."""

    policy: str = "trot"
    """Name of the policy, or folder of a trained policy."""
    robot: str = "go2"
    """Robot: a name of quad_env.ROBOTS, or the path of an MJCF, URDF or TOML file."""
    command: Command = (0.0, 0.0, 0.0)
    """Velocities without a remote control: forward m/s, left m/s, yaw rate rad/s."""
    seconds: float | None = None
    """Duration of walking on the robot's clock, s; by default until Ctrl-C."""
    wait: float = 10.0
    """Time to wait for the first state of the robot, s."""
    state_timeout: float = 0.1
    """Age of the newest state at which the motors are damped, s; more only for slow simulations."""
    trust: Flag = False
    """Load policies also from .zip files of Stable-Baselines3, which can contain hidden code."""


def main(options: DriveOptions) -> int:
    """Run the command `drive` with the given options, and return the exit code of the process."""
    limits = {"command": (-COMMAND_BOUND, COMMAND_BOUND), "seconds": (0.0, 86_400.0)}
    check_numbers(options, limits | {"wait": (0.0, 3600.0), "state_timeout": (0.02, 10.0)})
    hardware = parse_robot_option(options.robot)
    raise_on_interrupt()
    bus = options.connect()
    policy = DeployedPolicy(hardware.policy(options.policy, options.trust, on_hardware_profile=True))
    driver = Driver(bus, policy, np.array(options.command), options.state_timeout, print_line)
    print_line(f"{policy.policy.name} for {policy.robot.name}: waits for rt/lowstate; Ctrl-C damps the motors")
    try:
        # The motors are damped inside the block, because a Ctrl-C at the end must not leave them without damping.
        with Interrupt() as interrupt:
            try:
                _drive(driver, options, interrupt)
            finally:
                _damp(driver, policy.policy.control_period)
    except Stopped as stop:
        raise UsageError(f"{stop}; the motors were damped") from stop
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"{driver.walking_time:.1f} s walked; the motors are damped") from None
    print_line(f"{driver.walking_time:.1f} s walked; the motors are damped")
    return 0


def _drive(driver: Driver, options: DriveOptions, interrupt: Interrupt) -> None:
    """Drive the robot for the duration of the options, or until Ctrl-C."""
    start = time.monotonic()
    while not interrupt.requested:
        if driver.state is None and time.monotonic() - start > options.wait:
            where = f"domain {options.domain} on {options.interface}"
            raise UsageError(f"--interface: no rt/lowstate within {options.wait:g} s in {where}; is the robot there?")
        if not driver.update():
            time.sleep(POLL_PERIOD)
        if options.seconds is not None and driver.walking_time >= options.seconds:
            return


def _damp(driver: Driver, period: float) -> None:
    """Send damping commands at intervals of `period`, s, if the robot has published its state."""
    end = time.monotonic() + (0.0 if driver.state is None else DAMPING_TIME)
    while time.monotonic() < end:
        driver.damp()
        time.sleep(period)


def print_line(text: str) -> None:
    """Print a line of text at once."""
    print(text, flush=True)
