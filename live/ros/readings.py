"""What the robot tells at the end of a control step, as a packet of numbers for the process that speaks ROS."""

import numpy as np

from evaluate.rollouts.observers import Step
from live.imu import FELT, Imu
from live.ros.link import Packet
from live.ros.topics import IMU, JOINT_STATE_PERIOD, JOINT_STATES


class Readings:
    """Makes the packets of control steps that follow each other, of the first robot."""

    def __init__(self, dt: float) -> None:
        """`dt`: control period, s."""
        self._imu = Imu(dt)
        self._every = max(1, round(JOINT_STATE_PERIOD / dt))

    def of_step(self, step: Step, number: int, time: int) -> Packet:
        """The packet of a control step, the `number`-th since the beginning, which ended at that time, ns."""
        told = {name: values[0] for name, values in step.infos.items()}
        row = {name: np.array(told[name], float).reshape(1, -1) for name in FELT}
        quaternion, turning, force = np.split(self._imu.felt(row, np.array([step.number == 1]))[0], (4, 7))
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
                "position": told["joint_position"].tolist(),
                "velocity": told["joint_velocity"].tolist(),
                "torque": told["joint_torque"].tolist(),
            }
        return packet
