"""The process that speaks ROS: `python3 -m live.ros.node VERSION JOINT…`.

Its standard input is a socket to the simulation. It runs under whichever Python has ROS, 3.8 or later, and imports
nothing that does not come with that.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from typing import Any

JOINT_TARGETS = "/position_controller/command"
"""Taken, std_msgs/Float64MultiArray: joint targets, rad, in the robot's joint order."""
VELOCITY = "/cmd_vel"
"""Taken, geometry_msgs/Twist: linear.x and linear.y, m/s, and angular.z, rad/s, are the command of a policy."""
RESET = "/reset"
"""Taken, std_msgs/Empty: a new episode from the home pose."""
JOINT_STATES = "/joint_states"
"""Given, sensor_msgs/JointState: rad, rad/s and N·m."""
IMU = "/imu"
"""Given, sensor_msgs/Imu: orientation, angular velocity and specific force of the trunk."""
CLOCK = "/clock"
"""Given, rosgraph_msgs/Clock: simulated time."""
JOINT_STATE_PERIOD = 0.02
"""s between two messages of `JOINT_STATES`; the others are given at every control step."""
NODE = "simple_quad"
"""Name of the node."""
MAX_NUMBERS = 256
"""Numbers of a message that are handed on; of a longer one, which no robot wants, its size alone."""
MAX_PACKET_SIZE = 65_536
"""Bytes."""


def main(version: str, joints: list[str]) -> None:
    """Be a node until the simulation closes the socket."""
    link = socket.socket(fileno=os.dup(0))
    try:
        transport = _transport(version)(NODE, lambda why: _send_packet(link, {"ended": why}))
    except OSError as error:
        _send_packet(link, {"ended": str(error)})
        return
    Node(link, transport, joints).run()
    transport.close()
    os._exit(0)  # whatever threads ROS still has


def _transport(version: str) -> Any:
    if version == "1":
        from live.ros.ros1 import Ros1

        return Ros1
    from live.ros.ros2 import Ros2

    return Ros2


class Node:
    """Turns packets of the simulation into messages, and messages into packets."""

    def __init__(self, link: socket.socket, transport: Any, joints: list[str]) -> None:
        from geometry_msgs.msg import Twist
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import Imu, JointState
        from std_msgs.msg import Empty, Float64MultiArray

        self._link, self._stamp, self._joints = link, transport.stamp, joints
        self._kinds = {CLOCK: Clock, IMU: Imu, JOINT_STATES: JointState}
        self._publish = {topic: transport.publisher(topic, kind) for topic, kind in self._kinds.items()}
        transport.subscribe(JOINT_TARGETS, Float64MultiArray, self._take_joint_targets)
        transport.subscribe(VELOCITY, Twist, self._take_velocity)
        transport.subscribe(RESET, Empty, lambda message: self._forward(RESET, [], 0))
        _send_packet(link, {"ready": transport.where})

    def run(self) -> None:
        """Publish what comes, until the simulation closes the socket."""
        while True:
            try:
                data = self._link.recv(MAX_PACKET_SIZE)
            except ConnectionResetError:
                return
            if not data:
                return
            self._publish_packet(json.loads(data))

    def _publish_packet(self, packet: dict[str, Any]) -> None:
        stamp = self._stamp(packet["time"])
        clock = self._kinds[CLOCK]()
        clock.clock = stamp
        self._publish[CLOCK](clock)
        imu = self._message(IMU, stamp)
        reading = packet[IMU]
        w, x, y, z = reading["quaternion"]  # ROS has w last
        turn = imu.orientation
        turn.x, turn.y, turn.z, turn.w = x, y, z, w
        for vector, name in ((imu.angular_velocity, "angular_velocity"), (imu.linear_acceleration, "specific_force")):
            vector.x, vector.y, vector.z = reading[name]
        self._publish[IMU](imu)
        if JOINT_STATES in packet:
            reading, state = packet[JOINT_STATES], self._message(JOINT_STATES, stamp)
            state.name, state.position = self._joints, reading["position"]
            state.velocity, state.effort = reading["velocity"], reading["torque"]
            self._publish[JOINT_STATES](state)

    def _message(self, topic: str, stamp: Any) -> Any:
        message = self._kinds[topic]()
        message.header.stamp, message.header.frame_id = stamp, "base_link"
        return message

    def _take_joint_targets(self, message: Any) -> None:
        size = len(message.data)
        self._forward(JOINT_TARGETS, list(message.data) if size <= MAX_NUMBERS else [], size)

    def _take_velocity(self, message: Any) -> None:
        self._forward(VELOCITY, [message.linear.x, message.linear.y, message.angular.z], 3)

    def _forward(self, topic: str, values: list[float], size: int) -> None:
        _send_packet(self._link, {"topic": topic, "values": values, "size": size})


def _send_packet(link: socket.socket, packet: dict[str, Any]) -> None:
    try:
        link.send(json.dumps(packet).encode())
    except OSError:  # the simulation has ended
        os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
