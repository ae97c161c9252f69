"""The simulated robot follows only valid commands of one writer, and is damped with one line otherwise."""

from collections.abc import Callable

import numpy as np
import pytest

from live.unitree import command_guard
from live.unitree.checksum import seal
from live.unitree.command_guard import CommandGuard
from live.unitree.messages import Received, UnitreeMessage
from live.unitree.motors import DAMPING, MotorCommands, low_command

DT = 0.002
STANDING = MotorCommands(*(np.full(12, value) for value in (0.5, 0.0, 60.0, 5.0, 1.0)))


def packet(change: Callable[[UnitreeMessage], None] | None = None, writer: int = 1, is_sealed: bool = True) -> Received:
    message = low_command(STANDING)
    if change is not None:
        change(message)
    if is_sealed:
        seal(message)
    return Received(message.to_bytes(), writer)


def setting(path: str, value: float) -> Callable[[UnitreeMessage], None]:
    """Return a change of the first number of a field."""

    def change(message: UnitreeMessage) -> None:
        numbers = message.get(path)
        numbers[0] = value
        message.set(path, numbers)

    return change


class Robot:
    """Guard with a clock that advances by one step for each call, and the lines that it prints."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.guard = CommandGuard(self.lines.append)
        self.steps = 0

    def step(self, *packets: Received, count: int = 1) -> None:
        for _ in range(count):
            self.guard.update(packets, self.steps * DT, self.steps * DT)
            self.steps += 1

    @property
    def is_damped(self) -> bool:
        commands = self.guard.commands
        return not commands.kp.any() and not commands.tau.any() and (commands.kd == DAMPING).all()


def test_a_valid_command_is_followed_from_the_damped_start() -> None:
    robot = Robot()
    robot.step()
    assert robot.is_damped
    assert not robot.guard.has_followed
    robot.step(packet())
    assert all(np.array_equal(*pair) for pair in zip(robot.guard.commands, STANDING, strict=True))
    assert robot.lines == ["rt/lowcmd: followed"]


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (packet(setting("crc", 7), is_sealed=False), "wrong CRC, got 0x00000007; valid: 0x"),
        (packet(setting("motor_cmd.q", np.nan)), "a number is NaN or infinite"),
        (packet(setting("motor_cmd.tau", np.inf)), "a number is NaN or infinite"),
        (packet(setting("motor_cmd.kp", -3.0)), "negative gain, got -3; valid: from 0"),
        (Received(b"\x00\x01\x00\x00junk", 1), "LowCmd_: no message of this type, got 8 bytes"),
    ],
)
def test_an_invalid_command_damps_the_motors_until_the_next_valid_one(bad: Received, said: str) -> None:
    robot = Robot()
    robot.step(packet(), count=20)
    robot.step(bad, count=20)
    assert robot.is_damped
    assert [line for line in robot.lines if said in line] == robot.lines[1:]
    assert robot.lines[1].endswith("the motors are damped until the next valid command")
    assert sum(robot.guard.faults.values()) == 20
    robot.step(packet())
    assert not robot.is_damped


def test_commands_that_stop_damp_the_motors_after_the_timeout() -> None:
    robot = Robot()
    robot.step(packet())
    robot.step(count=round(command_guard.COMMAND_TIMEOUT / DT))
    assert not robot.is_damped
    robot.step(count=2)
    assert robot.is_damped
    assert robot.lines[1:] == [
        f"rt/lowcmd: no valid command for {command_guard.COMMAND_TIMEOUT:g} s; "
        "the motors are damped until the next valid command"
    ]


def test_two_writers_at_once_damp_the_motors_until_one_has_stopped() -> None:
    robot = Robot()
    robot.step(packet(), count=5)
    robot.step(packet(), packet(writer=2), count=10)
    assert robot.is_damped
    assert len([line for line in robot.lines if "2 writers at once" in line]) == 1
    robot.step(packet(), count=round(command_guard.WRITER_TIMEOUT / DT) + 2)
    assert not robot.is_damped


def test_a_writer_that_follows_another_is_no_second_writer() -> None:
    robot = Robot()
    robot.step(packet(), count=5)
    robot.step(count=round(command_guard.WRITER_TIMEOUT / DT) + 1)
    robot.step(packet(writer=2))
    assert not robot.is_damped


def test_a_flood_damps_the_motors_and_a_client_of_500_hz_that_was_held_up_does_not() -> None:
    robot = Robot()
    robot.step(*[packet()] * 30, count=1)
    robot.step(packet(), count=50)
    assert not robot.is_damped
    robot.step(*[packet()] * 20, count=50)
    assert robot.is_damped
    assert len([line for line in robot.lines if "over 4000 messages per second" in line]) == 1
    robot.step(packet(), count=round(command_guard.RATE_WINDOW / DT) + 2)
    assert not robot.is_damped
