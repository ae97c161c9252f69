"""Commands of Unitree's motors, and the conversion between the order of the motors and the joints of a robot."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from live.unitree.messages import UnitreeMessage
from policies.base import Floats
from policies.external.joint_mapping import map_joints
from policies.external.readers.joint_orders import UNITREE_MOTORS
from quad_env.robots.robot import JOINTS, Robot
from quad_env.robots.structure import JOINTS_PER_LEG

DAMPING = 3.0
"""Damping of a motor that has no valid command, N·m·s/rad; its stiffness is zero, so that the robot sinks slowly."""
ENABLED = 1
"""Value of the field `mode` of a motor that is driven."""
LEVEL_FLAG = 0xFF
"""Value of the field `level_flag` of low-level messages."""
HEAD = (0xFE, 0xEF)
"""Values of the field `head` of low-level messages."""


class MotorCommands(NamedTuple):
    """Commands of the 12 motors: torque = kp (q - angle) + kd (dq - speed) + tau, then limited."""

    q: Floats
    """Target angles, (12,), rad."""
    dq: Floats
    """Target speeds, (12,), rad/s."""
    kp: Floats
    """Stiffness, (12,), N·m/rad."""
    kd: Floats
    """Damping, (12,), N·m·s/rad."""
    tau: Floats
    """Feed-forward torques, (12,), N·m."""


def damped() -> MotorCommands:
    """Return the commands of damped motors, which have no stiffness."""
    zeros = np.zeros(JOINTS)
    return MotorCommands(q=zeros, dq=zeros, kp=zeros, kd=np.full(JOINTS, DAMPING), tau=zeros)


def read_commands(message: UnitreeMessage) -> MotorCommands:
    """Return the motor commands of a message `LowCmd_`, in the order of the motors."""
    return MotorCommands(*(message.get(f"motor_cmd.{name}")[:JOINTS].astype(float) for name in MotorCommands._fields))


def low_command(commands: MotorCommands) -> UnitreeMessage:
    """Return a message `LowCmd_` with motor commands in the order of the motors; its checksum is not set."""
    message = UnitreeMessage("LowCmd_")
    message.set("head", HEAD)
    message.set("level_flag", LEVEL_FLAG)
    mode = message.get("motor_cmd.mode")
    mode[:JOINTS] = ENABLED
    message.set("motor_cmd.mode", mode)
    for name, values in commands._asdict().items():
        message.set(f"motor_cmd.{name}", fill(message, f"motor_cmd.{name}", values))
    return message


def fill(message: UnitreeMessage, path: str, values: Floats) -> NDArray[np.generic]:
    """Return the numbers of the field `path` of a message, the first 12 of them replaced by `values`, (12,)."""
    numbers = message.get(path)
    numbers[:JOINTS] = values
    return numbers


class MotorOrder:
    """Conversion between Unitree's motors and the joints of a robot, by their names.

    The signs and zeros of the angles are converted too, because the joint angles of this project are zero with the legs
    straight down.

    A PolicyError is raised if a motor fits no joint of the robot.

    Args:
        robot: Robot with the joints.
    """

    def __init__(self, robot: Robot) -> None:
        self._mapping = map_joints(UNITREE_MOTORS, robot)
        self.leg_ids = self._mapping.joint_ids[::JOINTS_PER_LEG] // JOINTS_PER_LEG
        """Index of each of Unitree's legs (front right, front left, rear right, rear left) in the robot's, (4,)."""

    def angles_of_motors(self, angles: Floats) -> Floats:
        """Convert the joint angles of the robot to the angles of the motors, (12,), rad."""
        return np.asarray(self._mapping.policy_angles(angles[None])[0])

    def rates_of_motors(self, rates: Floats) -> Floats:
        """Convert joint velocities or torques of the robot to the order of the motors, (12,), in the same unit."""
        return np.asarray(self._mapping.policy_rates(rates[None])[0])

    def angles_of_joints(self, angles: Floats) -> Floats:
        """Convert the angles of the motors to the joint angles of the robot, (12,), rad."""
        return np.asarray(self._mapping.robot_angles(angles[None])[0])

    def rates_of_joints(self, rates: Floats) -> Floats:
        """Convert velocities or torques of the motors to the order of the joints, (12,), in the same unit."""
        return self._mapping.to_robot_order(self._mapping.signs * rates)

    def commands_of_joints(self, commands: MotorCommands) -> MotorCommands:
        """Convert motor commands to commands of the joints."""
        return MotorCommands(
            q=self.angles_of_joints(commands.q),
            dq=self.rates_of_joints(commands.dq),
            kp=self._mapping.to_robot_order(commands.kp),
            kd=self._mapping.to_robot_order(commands.kd),
            tau=self.rates_of_joints(commands.tau),
        )

    def commands_of_motors(self, commands: MotorCommands) -> MotorCommands:
        """Convert commands of the joints to motor commands."""
        return MotorCommands(
            q=self.angles_of_motors(commands.q),
            dq=self.rates_of_motors(commands.dq),
            kp=commands.kp[self._mapping.joint_ids],
            kd=commands.kd[self._mapping.joint_ids],
            tau=self.rates_of_motors(commands.tau),
        )
