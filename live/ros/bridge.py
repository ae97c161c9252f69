"""The robot's side of the ROS interface, without ROS: messages in as numbers, readings out, control step by step."""

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

JOIN_TIME, HOME_TIME = 0.2, 0.4
"""From where the joint targets are to those from outside as these begin, and back to the home pose, s."""


class JointTargetPolicy(Policy):
    """A policy that is driven from outside: stands until `follow`; every robot of it follows the same targets."""

    name = "driven"
    stiff_servos = True

    def __init__(self, robot: Robot = SIMPLE_QUAD) -> None:
        super().__init__(robot=robot)
        self._following = False
        self._allocate(1)

    def follow(self, targets: Floats) -> None:
        """Follow these joint targets, (12,), rad, as far as the joints go, until others come."""
        if not self._following:
            self._following, self._steps_left = True, self._steps(JOIN_TIME)
        self._goal = np.clip(targets, self.robot.joint_lower, self.robot.joint_upper)

    def release(self) -> None:
        """Follow nothing any more: from where the targets are to the home pose, and stay there."""
        self._following, self._goal, self._steps_left = False, self.robot.home_pose, self._steps(HOME_TIME)

    def _steps(self, duration: float) -> int:
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
    """The robot of a session, driven by messages: by joint targets if `Driven` moves it, else by velocities.

    The simulation goes on in any case: invalid messages are refused, and without valid ones the robot stands.

    Args:
        session: its commands are the bridge's from now on.
        say: called with lines for the terminal.
    """

    def __init__(self, session: Session, log: Callable[[str], None]) -> None:
        self._session, self._say = session, log
        self._driven = session.policy if isinstance(session.policy, JointTargetPolicy) else None
        self._topic, self._timeout = (VELOCITY, 0.5) if self._driven is None else (JOINT_TARGETS, 0.2)
        self._received: int | None = None
        """Number of the control step before which the latest valid message came; None before the first, and after a
        timeout."""
        self._refused: set[tuple[str, str]] = set()
        """Topics and kinds of messages that were refused, each of which is said once."""
        self._imu, self._fallen = TrunkImu(session.env.dt), False
        self._steps, self._period = 0, round(session.env.dt * 1e9)
        session.steer(np.zeros(3))
        session.reset(session.seed)

    @property
    def time(self) -> float:
        """Simulated s since the beginning; no reset turns it back."""
        return self._steps * self._period * 1e-9

    def handle_message(self, topic: str, values: Sequence[float], size: int) -> None:
        """A message of that topic with `size` numbers; of one that is too long, `values` need not have them."""
        if topic == RESET:
            self._session.reset()
            return
        numbers = np.asarray(values, np.float64)
        if (found := self._validation_error(topic, numbers, size)) is not None:
            mistake, details = found
            if (topic, mistake) not in self._refused:
                self._say(f"{topic}: refused, {mistake}{details}; further ones are refused without a word")
            self._refused.add((topic, mistake))
            return
        if self._driven is None:
            self._session.steer(numbers)
        else:
            self._driven.follow(numbers)
        if self._received is None:
            self._say(f"{topic} is followed")
        self._received = self._steps

    def step(self) -> Packet:
        """Packet of the robot after a further control step."""
        if self._received is not None and self._steps - self._received > round(self._timeout / self._session.env.dt):
            self._stand()
        step = self._session.step()
        self._steps += 1
        packet = self._packet(step)
        fall, self._fallen = int(step.infos["fall"][0]), self._fallen and step.number > 1
        if fall and not self._fallen:
            self._fallen = True
            self._say(f"the robot has fallen ({FALL_REASONS[fall]}); a message on {RESET} resets it")
        if step.infos["diverged"][0]:
            self._say("the simulation has diverged; the robot is reset")
            self._session.reset()
        return packet

    def _validation_error(self, topic: str, values: Floats, size: int) -> tuple[str, str] | None:
        """Reason to refuse a message: its kind, the same for all that are wrong in this way, and details."""
        joints = self._session.env.robot.num_joints
        if topic != self._topic:
            return f"{self._topic} moves this robot", ""
        if self._driven is not None and size != joints:
            return f"not {joints} numbers", f" but {size}"
        if not np.isfinite(values).all():
            return "not finite", f": {values.tolist()}"
        if self._driven is None and (np.abs(values) > COMMAND_BOUND).any():
            return f"beyond ±{COMMAND_BOUND:g} m/s or rad/s", f": {values.tolist()}"
        return None

    def _stand(self) -> None:
        self._received = None
        if self._driven is None:
            self._session.steer(np.zeros(3))
            standing = "the command is zero"
        else:
            self._driven.release()
            standing = "the robot returns to its standing pose"
        self._say(f"nothing good on {self._topic} for {self._timeout:g} s: {standing} until the next")

    def _packet(self, step: Step) -> Packet:
        infos = {name: values[0] for name, values in step.infos.items()}

        def numbers(**names: str) -> dict[str, list[float]]:
            return {name: infos[reading].tolist() for name, reading in names.items()}

        imu = numbers(quaternion="quaternion", angular_velocity="angular_velocity")
        imu["specific_force"] = self._imu.specific_force(infos, is_first=step.number == 1).tolist()
        packet: Packet = {"time": self._steps * self._period, IMU: imu}
        if self._steps % max(1, round(JOINT_STATE_PERIOD / step.env.dt)) == 0:
            packet[JOINT_STATES] = numbers(position="joint_position", velocity="joint_velocity", torque="joint_torque")
        return packet
