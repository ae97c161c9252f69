"""What the robot tells at the end of a control step, as a packet of numbers for the process that speaks ROS."""

from evaluate.rollouts.observers import Step
from live.readings import Accelerometer
from live.ros.link import Packet
from live.ros.topics import IMU, JOINT_STATE_PERIOD, JOINT_STATES


class Readings:
    """Makes the packets of control steps that follow each other, of the first robot."""

    def __init__(self, dt: float) -> None:
        """`dt`: control period, s."""
        self._accelerometer = Accelerometer(dt)
        self._every = max(1, round(JOINT_STATE_PERIOD / dt))

    def of_step(self, step: Step, number: int, time: int) -> Packet:
        """The packet of a control step, the `number`-th since the beginning, which ended at that time, ns."""
        if step.number == 1:
            self._accelerometer.restart()
        told = {name: values[0] for name, values in step.infos.items()}
        force = self._accelerometer.read(told["quaternion"], told["heading_velocity"], told["vertical_velocity"])
        packet: Packet = {
            "time": time,
            IMU: {
                "quaternion": told["quaternion"].tolist(),
                "angular_velocity": told["angular_velocity"].tolist(),
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
