"""The simulated robot on the network: takes motor commands and publishes its state, in real time."""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from live.unitree.checksum import seal
from live.unitree.command_guard import CommandGuard
from live.unitree.low_level_robot import RATE, LowLevelReading, LowLevelRobot
from live.unitree.messages import UnitreeMessage
from live.unitree.motors import HEAD, LEVEL_FLAG, MotorOrder, fill
from live.unitree.topics import LOW_COMMAND, LOW_STATE, SPORT_STATE
from policies.base import Floats
from quad_env.cli.interrupt import Interrupt
from quad_env.cli.real_time_rate import RealTimeRate
from quad_env.physics.rotations import roll_pitch_yaw
from quad_env.robots.robot import JOINTS

if TYPE_CHECKING:
    from live.unitree.dds import Bus

MAX_LATENESS = 0.001
"""Delay of a step behind its due time above which it counts as late, s."""
_MAX_FORCE = np.iinfo(np.int16).max


@dataclass
class TimingReport:
    """Counts of the steps of a real-time loop."""

    steps: int = 0
    late_steps: int = 0
    """Number of steps that began more than `MAX_LATENESS` after their due time."""
    wall_time: float = 0.0
    """Duration of the loop, s."""

    def __str__(self) -> str:
        rate = self.steps / max(self.wall_time, 1e-9)
        late = 100.0 * self.late_steps / max(self.steps, 1)
        text = f"{self.steps} steps in {self.wall_time:.1f} s: {rate:.1f} Hz of {RATE:g} Hz"
        return f"{text}, {late:.1f} % of the steps late by more than {1000 * MAX_LATENESS:g} ms"


class SimulatedUnitree:
    """Simulated robot that speaks the low-level interface of Unitree's robots.

    Args:
        robot: Simulated robot.
        bus: Participant on the network.
        log: Function that prints a line of text.

    Attributes:
        timing: Counts of the steps so far.
    """

    def __init__(self, robot: LowLevelRobot, bus: "Bus", log: Callable[[str], None]) -> None:
        self._robot = robot
        self._order = MotorOrder(robot.robot)
        self._commands = bus.subscribe(LOW_COMMAND, "LowCmd_")
        self._low_state = bus.publisher(LOW_STATE, "LowState_")
        self._sport_state = bus.publisher(SPORT_STATE, "SportModeState_")
        self.guard = CommandGuard(log)
        """Check of the received commands."""
        self._log = log
        self.timing = TimingReport()
        self.time = 0.0
        """Simulated time, s."""

    def run(self, seconds: float, interrupt: Interrupt) -> None:
        """Simulate in real time until the duration is over, or until Ctrl-C.

        Args:
            seconds: Duration, simulated s; it may be infinite.
            interrupt: Handler of Ctrl-C.
        """
        timer = RealTimeRate(1.0 / RATE)
        start = monotonic()
        for _ in range(round(min(seconds * RATE, 2.0**62))):
            if interrupt.requested:
                return
            self.step()
            timer.wait()
            self.timing.steps += 1
            self.timing.late_steps += timer.lag > MAX_LATENESS
            self.timing.wall_time = monotonic() - start

    def step(self) -> None:
        """Take the commands that have arrived, simulate one step, and publish the state after it."""
        guard = self.guard
        guard.update(self._commands.take(), self.time, monotonic())
        reading = self._robot.step(self._order.commands_of_joints(guard.commands), guard.has_followed)
        self.time = reading.time
        if self._robot.has_diverged:
            self._log("the simulation has diverged; the robot is back in its home pose")
        self._low_state.write(low_state(reading, self._order))
        self._sport_state.write(sport_state(reading, self._order))


def low_state(reading: LowLevelReading, order: MotorOrder) -> UnitreeMessage:
    """Return the message `LowState_` with the readings of a robot and its checksum.

    Args:
        reading: Readings of the robot.
        order: Order of the motors.

    Returns:
        The message; the tick is the simulated time in ms.
    """
    message = UnitreeMessage("LowState_")
    message.set("head", HEAD)
    message.set("level_flag", LEVEL_FLAG)
    _set_imu(message, reading)
    motors = {
        "q": order.angles_of_motors(reading.joint_position),
        "dq": order.rates_of_motors(reading.joint_velocity),
        "tau_est": order.rates_of_motors(reading.joint_torque),
        "mode": np.ones(JOINTS),
    }
    for name, values in motors.items():
        message.set(f"motor_state.{name}", fill(message, f"motor_state.{name}", values))
    forces = _foot_forces(reading, order)
    message.set("foot_force", forces)
    message.set("foot_force_est", forces)
    message.set("tick", round(reading.time * 1000.0) % 2**32)
    seal(message)
    return message


def sport_state(reading: LowLevelReading, order: MotorOrder) -> UnitreeMessage:
    """Return the message `SportModeState_` of a robot.

    Position and velocity are in the world frame, the frame of the robot's odometry.

    Args:
        reading: Readings of the robot.
        order: Order of the legs.

    Returns:
        The message.
    """
    message = UnitreeMessage("SportModeState_")
    message.set("stamp.sec", int(reading.time))
    message.set("stamp.nanosec", round(reading.time % 1.0 * 1e9) % 10**9)
    _set_imu(message, reading)
    message.set("position", reading.position)
    message.set("body_height", reading.height)
    message.set("velocity", reading.velocity)
    message.set("yaw_speed", reading.yaw_rate)
    message.set("foot_force", _foot_forces(reading, order))
    return message


def _set_imu(message: UnitreeMessage, reading: LowLevelReading) -> None:
    """Write the readings of the IMU into a message."""
    message.set("imu_state.quaternion", reading.quaternion)
    message.set("imu_state.gyroscope", reading.gyroscope)
    message.set("imu_state.accelerometer", reading.accelerometer)
    message.set("imu_state.rpy", roll_pitch_yaw(reading.quaternion))


def _foot_forces(reading: LowLevelReading, order: MotorOrder) -> Floats:
    """Return the force on each foot in Unitree's order of the legs, rounded to whole N, (4,)."""
    return np.clip(np.rint(reading.foot_force[order.leg_ids]), 0, _MAX_FORCE)
