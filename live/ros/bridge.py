"""Simulation side of the ROS interface: controls the simulated robot with the numbers of received ROS messages.

In every control step, the module returns sensor readings for ROS. A separate process imports ROS; this module does not.
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
"""Duration of the transition from the present joint targets to the first joint targets from ROS, s."""
HOME_TIME = 0.4
"""Duration of the transition of the joint targets to the home pose after joint targets from ROS have stopped, s."""
VELOCITY_TIMEOUT = 0.5
"""Time after the last valid velocity message at which the velocity command becomes zero, s."""
TARGET_TIMEOUT = 0.2
"""Time after the last valid joint targets at which the robot starts to return to the home pose, s."""


class JointTargetPolicy(Policy):
    """Policy that follows joint targets from outside, here from ROS messages.

    The robot stands in the home pose until `follow` is called. If there are several robots, all follow the same joint
    targets.

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
        """Set the joint targets that the robot follows until the next call of `follow` or `release`.

        Args:
            targets: Joint targets, (12,), rad; they are clipped to the joint limits.
        """
        if not self._following:
            self._following = True
            self._steps_left = self._steps(JOIN_TIME)
        self._goal = np.clip(targets, self.robot.joint_lower, self.robot.joint_upper)

    def release(self) -> None:
        """Stop following joint targets: move the robot to the home pose within HOME_TIME and hold this pose."""
        self._following = False
        self._goal = self.robot.home_pose
        self._steps_left = self._steps(HOME_TIME)

    def _steps(self, duration: float) -> int:
        """Return the number of control steps of a transition of the joint targets that takes `duration`, s."""
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
    """Controls the robot of a session with messages from ROS, and returns sensor readings for ROS.

    The messages are joint targets if the policy of the session is a `JointTargetPolicy`, otherwise velocity commands.
    Invalid messages are refused. If valid messages stop arriving, the robot stands, and the simulation continues.

    Args:
        session: Session with the simulated robot; the bridge sets its velocity command.
        log: Function that prints a line of text in the terminal.
    """

    def __init__(self, session: Session, log: Callable[[str], None]) -> None:
        self._session = session
        self._log = log
        self._target_policy = session.policy if isinstance(session.policy, JointTargetPolicy) else None
        self._topic = VELOCITY if self._target_policy is None else JOINT_TARGETS
        self._timeout = VELOCITY_TIMEOUT if self._target_policy is None else TARGET_TIMEOUT
        self._last_message_step: int | None = None
        """Number of control steps, `_steps`, at the arrival of the last valid message.

        None before the first valid message and after a timeout.
        """
        self._refused: set[tuple[str, str]] = set()
        """Topics and reasons of refused messages so far; each pair of topic and reason is logged only once."""
        self._imu = TrunkImu(session.env.dt)
        self._has_fallen = False
        self._steps = 0
        self._period = round(session.env.dt * 1e9)
        session.steer(np.zeros(3))
        session.reset(session.seed)

    @property
    def time(self) -> float:
        """Simulated time since the start of the bridge, s; the time continues if the robot is reset."""
        return self._steps * self._period * 1e-9

    def handle_message(self, topic: str, values: Sequence[float], size: int) -> None:
        """Handle a message from ROS: reset the robot, set its velocity command or set its joint targets.

        Args:
            topic: Topic of the message.
            values: Numbers of the message: joint targets, rad, or forward and left velocity, m/s, and yaw rate, rad/s.
                The sequence is empty if the message has too many numbers.
            size: Number of numbers in the message.
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
        """Simulate one control step of the robot, and return its sensor readings as a packet for the ROS process."""
        if self._has_timed_out():
            self._stand()
        step = self._session.step()
        self._steps += 1
        packet = self._packet(step)
        self._report(step)
        return packet

    def _has_timed_out(self) -> bool:
        """Return True if the last valid message is older than the timeout; False before the first message."""
        if self._last_message_step is None:
            return False
        return self._steps - self._last_message_step > round(self._timeout / self._session.env.dt)

    def _report(self, step: Step) -> None:
        """Log a fall of the robot once per episode, and reset the robot if the simulation has diverged."""
        fall = int(step.infos["fall"][0])
        self._has_fallen = self._has_fallen and step.number > 1
        if fall and not self._has_fallen:
            self._has_fallen = True
            self._log(f"the robot has fallen ({FALL_REASONS[fall]}); a message on {RESET} resets it")
        if step.infos["diverged"][0]:
            self._log("the simulation has diverged; the robot is reset")
            self._session.reset()

    def _validation_error(self, topic: str, values: Floats, size: int) -> tuple[str, str] | None:
        """Check a message from ROS.

        Args:
            topic: Topic of the message.
            values: Numbers of the message.
            size: Number of numbers in the message; `values` is empty if there are too many.

        Returns:
            None if the message is valid. Otherwise the reason of the refusal, and details. The reason is the same text
            for every message with the same fault; the details differ.
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
        """Make the robot stand after a timeout: set a zero velocity command, or return to the home pose."""
        self._last_message_step = None
        if self._target_policy is None:
            self._session.steer(np.zeros(3))
            standing = "the command is zero"
        else:
            self._target_policy.release()
            standing = "the robot returns to its standing pose"
        self._log(f"nothing good on {self._topic} for {self._timeout:g} s: {standing} until the next")

    def _packet(self, step: Step) -> Packet:
        """Return time and sensor readings of the robot after a control step, as a packet for the ROS process."""
        infos = {name: values[0] for name, values in step.infos.items()}

        def numbers(**names: str) -> dict[str, list[float]]:
            """Return the readings of the robot that the arguments NAME=KEY select: NAME -> numbers in `infos[KEY]`."""
            return {name: infos[reading].tolist() for name, reading in names.items()}

        imu = numbers(quaternion="quaternion", angular_velocity="angular_velocity")
        imu["specific_force"] = self._imu.specific_force(infos, is_first=step.number == 1).tolist()
        packet: Packet = {"time": self._steps * self._period, IMU: imu}
        if self._steps % max(1, round(JOINT_STATE_PERIOD / step.env.dt)) == 0:
            packet[JOINT_STATES] = numbers(position="joint_position", velocity="joint_velocity", torque="joint_torque")
        return packet
