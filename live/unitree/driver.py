"""Client that drives a robot over its low-level interface: stands up, follows a policy, and damps on danger."""

from collections.abc import Callable
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from live.unitree.checksum import seal
from live.unitree.deployment import DeployedPolicy, RobotState
from live.unitree.messages import UnitreeMessage
from live.unitree.motors import MotorCommands, MotorOrder, damped, low_command
from live.unitree.remote_control import RemoteControl, is_stop
from live.unitree.topics import LOW_COMMAND, LOW_STATE, WIRELESS_CONTROLLER
from policies.base import Floats
from policies.gait_cycle import smoothstep
from policies.safety.target_limits import SafetyLimits
from quad_env.robots.robot import JOINTS

if TYPE_CHECKING:
    from live.unitree.dds import Bus

STAND_TIME = 2.0
"""Duration of standing up from the present pose to the home pose, s."""
SETTLE_TIME = 0.5
"""Duration of standing before the policy acts; the servo gains change to the gains of the policy, s."""
STAND_STIFFNESS = 60.0
"""Stiffness of the joints while the robot stands up, N·m/rad; the stand example of Unitree's SDK has it."""
STAND_DAMPING = 5.0
"""Damping of the joints while the robot stands up, N·m·s/rad; the stand example of Unitree's SDK has it."""
MAX_TILT = 1.0
"""Tilt of the trunk at which the motors are damped, rad."""
JOINT_MARGIN = 0.2
"""Angle beyond a joint limit at which the motors are damped, rad."""
REMOTE_TIMEOUT = 0.5
"""Time after the last message of the remote control at which its command becomes zero, s."""
DAMPING_TIME = 1.0
"""Duration for which damping commands are sent at the end, s."""


class Stopped(Exception):  # noqa: N818 -- The end of a drive is no error by itself.
    """Raised if the robot must be damped; the message has the reason."""


class Driver:
    """Client that drives one robot: it turns each published state into motor commands.

    The control steps follow the clock of the robot, the field `tick` of its state.

    Args:
        bus: Participant on the network.
        policy: Policy that walks.
        command: Velocity command without a remote control, (3,): forward and left m/s, yaw rate rad/s.
        state_timeout: Age of the newest state at which the motors are damped, s.
        log: Function that prints a line of text.
    """

    def __init__(
        self, bus: "Bus", policy: DeployedPolicy, command: Floats, state_timeout: float, log: Callable[[str], None]
    ) -> None:
        self._policy = policy
        self._robot = policy.robot
        self._order = MotorOrder(self._robot)
        self._state_timeout = state_timeout
        self._log = log
        self._low_state = bus.subscribe(LOW_STATE, "LowState_")
        self._remote_messages = bus.subscribe(WIRELESS_CONTROLLER, "WirelessController_")
        self._low_command = bus.publisher(LOW_COMMAND, "LowCmd_")
        self._remote = RemoteControl(self._robot)
        self._limits = SafetyLimits.for_robot(self._robot)
        self._command = command
        self._remote_time: float | None = None
        self._state_time = monotonic()
        self.state: RobotState | None = None
        """Newest state of the robot; None before the first one."""
        self.walking_steps = 0
        """Number of control steps of the policy so far."""
        self._next_tick = 0
        self._start_tick = 0
        self._start_pose = self._robot.home_pose
        self._targets = self._robot.home_pose

    def update(self) -> bool:
        """Take the received messages into account, and send motor commands if a control step is due.

        Returns:
            True if motor commands were sent.

        Raises:
            Stopped: The robot must be damped.
        """
        self._read_remote()
        has_new_state = self._read_state()
        state = self.state
        if state is None:
            return False
        if monotonic() - self._state_time > self._state_timeout:
            raise Stopped(f"no rt/lowstate for {1000 * self._state_timeout:g} ms")
        if not has_new_state or state.tick < self._next_tick:
            return False
        self._check_danger(state)
        period = round(1000 * self._policy.policy.control_period)
        is_on_time = state.tick < self._next_tick + period
        self._next_tick = period + (self._next_tick if is_on_time else state.tick)
        self._send(self._commands(state))
        return True

    def damp(self) -> None:
        """Send one message with damped motors."""
        self._send_motors(damped())

    @property
    def walking_time(self) -> float:
        """Duration for which the policy has acted, on the clock of the robot, s."""
        return self.walking_steps * self._policy.policy.control_period

    @property
    def is_walking(self) -> bool:
        """True if the policy acts."""
        return self.walking_steps > 0

    def _read_state(self) -> bool:
        """Read the newest state; return False if there is none."""
        received = self._low_state.take()
        if not received:
            return False
        try:
            state = RobotState(UnitreeMessage("LowState_", received[-1].data), self._order)
        except ValueError as error:
            raise Stopped(str(error)) from error
        if self.state is None:
            self._start_tick = state.tick
            self._next_tick = state.tick
            self._start_pose = state.joint_position
            self._targets = state.joint_position
            self._log("rt/lowstate arrives; the robot stands up")
        elif state.tick < self.state.tick:
            raise Stopped(f"the clock of the robot went back from {self.state.tick} to {state.tick} ms")
        self.state = state
        self._state_time = monotonic()
        return True

    def _read_remote(self) -> None:
        """Set the velocity command from the remote control, or to zero after it has stopped sending."""
        received = self._remote_messages.take()
        for each in received[-1:]:
            message = UnitreeMessage("WirelessController_", each.data)
            if is_stop(message):
                raise Stopped("L2 and B are pressed on the remote control")
            if self._remote_time is None:
                self._log("the remote control gives the velocities")
            self._remote_time = monotonic()
            self._command = self._remote.command(message)
        if self._remote_time is not None and monotonic() - self._remote_time > REMOTE_TIMEOUT:
            self._command = np.zeros(3)

    def _check_danger(self, state: RobotState) -> None:
        """Raise `Stopped` if the trunk is tilted too far or a joint is beyond its limits.

        While the robot stands up, its joints may be anywhere.
        """
        if state.tilt > MAX_TILT:
            raise Stopped(f"the trunk is tilted by {np.degrees(state.tilt):.0f}°, over {np.degrees(MAX_TILT):.0f}°")
        beyond = np.maximum(
            self._robot.joint_lower - state.joint_position, state.joint_position - self._robot.joint_upper
        )
        if self.is_walking and beyond.max() > JOINT_MARGIN:
            joint = self._robot.joint_names[int(beyond.argmax())]
            raise Stopped(f"{joint} is {beyond.max():.2f} rad beyond its limit")

    def _commands(self, state: RobotState) -> MotorCommands:
        """Return the commands of the joints for a control step."""
        elapsed = (state.tick - self._start_tick) / 1000.0
        if elapsed < STAND_TIME + SETTLE_TIME:
            share = float(smoothstep(np.array(min(elapsed / STAND_TIME, 1.0))))
            blend = min(max((elapsed - STAND_TIME) / SETTLE_TIME, 0.0), 1.0)
            targets = self._start_pose + share * (self._robot.home_pose - self._start_pose)
            stiffness = STAND_STIFFNESS + blend * (self._robot.servo_stiffness - STAND_STIFFNESS)
            damping = STAND_DAMPING + blend * (self._robot.servo_damping - STAND_DAMPING)
        else:
            if not self.is_walking:
                self._log(f"{self._policy.policy.name} acts")
                self._policy.reset()
            targets = self._policy.act(state, self._command)
            stiffness = self._robot.servo_stiffness
            damping = self._robot.servo_damping
            self.walking_steps += 1
        robot = self._robot.with_servo(np.broadcast_to(stiffness, JOINTS), np.broadcast_to(damping, JOINTS))
        period = self._policy.policy.control_period
        rows = (targets, self._targets, state.joint_position, state.joint_velocity)
        self._targets = self._limits.limit_targets(robot, period, *(row[None] for row in rows))[0]
        if not np.isfinite(self._targets).all():
            raise Stopped(f"{self._policy.policy.name} gives joint targets that are not finite")
        zeros = np.zeros(JOINTS)
        return MotorCommands(self._targets, zeros, robot.servo_stiffness, robot.servo_damping, zeros)

    def _send(self, commands: MotorCommands) -> None:
        """Send commands of the joints."""
        self._send_motors(self._order.commands_of_motors(commands))

    def _send_motors(self, commands: MotorCommands) -> None:
        """Send commands in the order of the motors."""
        message = low_command(commands)
        seal(message)
        self._low_command.write(message)
