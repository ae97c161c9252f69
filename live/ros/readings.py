"""Readings of the robot after a control step, for the process that speaks ROS, and its falls, for the terminal."""

import numpy as np

from evaluate.rollouts.observers import Step
from live.imu import READINGS, Imu
from live.ros.link import Packet
from live.ros.topics import IMU, JOINT_STATE_PERIOD, JOINT_STATES, RESET
from quad_env.config import FALL_REASONS

UP_TIME = 1.0
"""Time without a fall after which a robot counts as up again, s."""


class Readings:
    """Makes the packets of control steps that follow each other, of the first robot."""

    def __init__(self, dt: float) -> None:
        """`dt`: control period, s."""
        self._imu = Imu(dt)
        self._every = max(1, round(JOINT_STATE_PERIOD / dt))

    def of_step(self, step: Step, number: int, time: int) -> Packet:
        """The packet of a control step, the `number`-th since the beginning, which ended at that time, ns."""
        infos = {name: values[0] for name, values in step.infos.items()}
        row = {name: np.array(infos[name], float).reshape(1, -1) for name in READINGS}
        quaternion, turning, force = np.split(self._imu.measure(row, np.array([step.number == 1]))[0], (4, 7))
        packet: Packet = {
            "time": time,
            IMU: {
                "quaternion": quaternion.tolist(),
                "angular_velocity": turning.tolist(),
                "specific_force": force.tolist(),
            },
        }
        if number % self._every == 0:
            packet[JOINT_STATES] = {
                "position": infos["joint_position"].tolist(),
                "velocity": infos["joint_velocity"].tolist(),
                "torque": infos["joint_torque"].tolist(),
            }
        return packet


class FallWatch:
    """Reports when the first robot falls, by the environment's rule, and when it is up again."""

    def __init__(self, dt: float) -> None:
        """`dt`: control period, s."""
        self._steps_up = round(UP_TIME / dt)
        self._fallen, self._upright = False, 0

    def __call__(self, step: Step) -> str | None:
        """Line about that control step, None without news."""
        fall = int(step.infos["fall"][0])
        if step.number <= 1:
            self._fallen = False
        self._upright = 0 if fall else self._upright + 1
        if fall and not self._fallen:
            self._fallen = True
            return f"the robot has fallen ({FALL_REASONS[fall]}); a message on {RESET} resets it"
        if self._fallen and self._upright == self._steps_up:
            self._fallen = False
            return "the robot is up again"
        return None
