"""Robot side of the ROS interface, which does not import ROS.

It controls the robot by numbers from ROS messages, and returns readings at every control step.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.observers import Step
from live.ros.node import IMU, JOINT_STATE_PERIOD, JOINT_STATES, JOINT_TARGETS, RESET, VELOCITY
from live.ros.ros_process import Packet
from live.session import Session
from live.trunk_imu import TrunkImu
from policies.base import Actions, Floats, Mask, Policy, to_actions
from quad_env.config import COMMAND_BOUND, FALL_REASONS
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

JOIN_TIME = 0.2
"""Time in which the joint targets blend from the present targets to the first external targets, s."""
HOME_TIME = 0.4
"""Time in which the joint targets return to the home pose after external joint targets end, s."""
VELOCITY_TIMEOUT = 0.5
"""Time since the last valid velocity message after which the command becomes zero, s."""
TARGET_TIMEOUT = 0.2
"""Time since the last valid joint targets after which the robot returns to the home pose, s."""


class JointTargetPolicy(Policy):
    """Policy that follows external joint targets.

    The robot stands in the home pose until `follow` is called. If there are several robots, all get the same targets.

    Args:
        robot: Robot that the policy controls.
    """

    name = "driven"
    stiff_servos = True

    def __init__(self, robot: Robot = SIMPLE_QUAD) -> None:
        super().__init__(robot=robot)
        self._following = False
        self._allocate(1)

    def follow(self, targets: Floats) -> None:
        """Follow the joint `targets`, clipped to the joint limits, until the next call, (12,), rad."""
        if not self._following:
            self._following = True
            self._steps_left = self._steps(JOIN_TIME)
        self._goal = np.clip(targets, self.robot.joint_lower, self.robot.joint_upper)

    def release(self) -> None:
        """Stop following external targets, return to the home pose and stay there."""
        self._following = False
        self._goal = self.robot.home_pose
        self._steps_left = self._steps(HOME_TIME)

    def _steps(self, duration: float) -> int:
        """Return the number of control steps of a blend that takes `duration`, s."""
        return 1 + round(duration / self.control_period)

    def _allocate(self, num_envs: int) -> None:
        self._targets = np.tile(self.robot.home_pose, (num_envs, 1))
        self.release()

    def _reset_rows(self, mask: Mask) -> None:
        self._targets[mask] = self.robot.home_pose

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._targets = self._targets + (self._goal - self._targets) / self._steps_left
        self._steps_left = max(1, self._steps_left - 1)
        return to_actions(self.robot, self._targets)


class Bridge:
    """Controls the robot of a session by messages from ROS.

    The messages are joint targets if the policy of the session is a `JointTargetPolicy`, otherwise velocities. Invalid
    messages are refused. The robot stands if no valid messages arrive; the simulation never stops.

    Args:
        session: Session of the robot; the bridge sets the commands of the session.
        log: Function that is called with each line for the terminal.
    """

    def __init__(self, session: Session, log: Callable[[str], None]) -> None:
        self._session = session
        self._log = log
        self._target_policy = session.policy if isinstance(session.policy, JointTargetPolicy) else None
        self._topic = VELOCITY if self._target_policy is None else JOINT_TARGETS
        self._timeout = VELOCITY_TIMEOUT if self._target_policy is None else TARGET_TIMEOUT
        self._last_message_step: int | None = None
        """Number of control steps before the last valid message; None before the first and after a timeout."""
        self._refused: set[tuple[str, str]] = set()
        """Pairs of topic and reason of refused messages; each pair is logged only once."""
        self._imu = TrunkImu(session.env.dt)
        self._has_fallen = False
        self._steps = 0
        self._period = round(session.env.dt * 1e9)
        session.steer(np.zeros(3))
        session.reset(session.seed)

    @property
    def time(self) -> float:
        """Simulated time since the start of the bridge, s; a reset of the robot does not change it."""
        return self._steps * self._period * 1e-9

    def handle_message(self, topic: str, values: Sequence[float], size: int) -> None:
        """Handle a message from ROS.

        Args:
            topic: Topic of the message.
            values: Numbers of the message; may be empty if the message is too long.
            size: Count of the numbers in the message.
        """
        if topic == RESET:
            self._session.reset()
            return
        numbers = np.asarray(values, np.float64)
        if (refusal := self._validation_error(topic, numbers, size)) is not None:
            reason, details = refusal
            if (topic, reason) not in self._refused:
                self._log(f"{topic}: refused, {reason}{details}; further ones are refused without a word")
            self._refused.add((topic, reason))
            return
        if self._target_policy is None:
            self._session.steer(numbers)
        else:
            self._target_policy.follow(numbers)
        if self._last_message_step is None:
            self._log(f"{topic} is followed")
        self._last_message_step = self._steps

    def step(self) -> Packet:
        """Advance the robot by one control step and return the packet of readings for ROS."""
        if self._has_timed_out():
            self._stand()
        step = self._session.step()
        self._steps += 1
        packet = self._packet(step)
        self._report(step)
        return packet

    def _has_timed_out(self) -> bool:
        """Return True if there was a valid message and the last one is older than the timeout."""
        if self._last_message_step is None:
            return False
        return self._steps - self._last_message_step > round(self._timeout / self._session.env.dt)

    def _report(self, step: Step) -> None:
        """Log a fall once per episode, and reset a diverged simulation."""
        fall = int(step.infos["fall"][0])
        self._has_fallen = self._has_fallen and step.number > 1
        if fall and not self._has_fallen:
            self._has_fallen = True
            self._log(f"the robot has fallen ({FALL_REASONS[fall]}); a message on {RESET} resets it")
        if step.infos["diverged"][0]:
            self._log("the simulation has diverged; the robot is reset")
            self._session.reset()

    def _validation_error(self, topic: str, values: Floats, size: int) -> tuple[str, str] | None:
        """Return the reason why a message is refused, and details; None if the message is valid.

        The reason is the same text for every message with the same fault; the details differ.
        """
        joints = self._session.env.robot.num_joints
        if topic != self._topic:
            return f"{self._topic} moves this robot", ""
        if self._target_policy is not None and size != joints:
            return f"not {joints} numbers", f" but {size}"
        if not np.isfinite(values).all():
            return "not finite", f": {values.tolist()}"
        if self._target_policy is None and (np.abs(values) > COMMAND_BOUND).any():
            return f"beyond ±{COMMAND_BOUND:g} m/s or rad/s", f": {values.tolist()}"
        return None

    def _stand(self) -> None:
        """Make the robot stand after a timeout."""
        self._last_message_step = None
        if self._target_policy is None:
            self._session.steer(np.zeros(3))
            standing = "the command is zero"
        else:
            self._target_policy.release()
            standing = "the robot returns to its standing pose"
        self._log(f"nothing good on {self._topic} for {self._timeout:g} s: {standing} until the next")

    def _packet(self, step: Step) -> Packet:
        """Return the packet with the readings of the robot after a control step."""
        infos = {name: values[0] for name, values in step.infos.items()}

        def numbers(**names: str) -> dict[str, list[float]]:
            """Return the infos named by the keyword values as lists under the keyword names."""
            return {name: infos[reading].tolist() for name, reading in names.items()}

        imu = numbers(quaternion="quaternion", angular_velocity="angular_velocity")
        imu["specific_force"] = self._imu.specific_force(infos, is_first=step.number == 1).tolist()
        packet: Packet = {"time": self._steps * self._period, IMU: imu}
        if self._steps % max(1, round(JOINT_STATE_PERIOD / step.env.dt)) == 0:
            packet[JOINT_STATES] = numbers(position="joint_position", velocity="joint_velocity", torque="joint_torque")
        return packet
