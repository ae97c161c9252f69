"""Main module of the ROS process, which connects the simulated robot to ROS.

The command line is `python3 -m live.ros.node VERSION JOINT…`. The standard input of the process is a socket to the
simulation. The module runs under any Python from 3.8 on that has ROS, and imports only the standard library and ROS.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from typing import Any

JOINT_TARGETS = "/position_controller/command"
"""Subscribed topic of type std_msgs/Float64MultiArray: joint targets, rad, in the joint order of the robot."""
VELOCITY = "/cmd_vel"
"""Subscribed topic of type geometry_msgs/Twist: velocity command of the policy.

The command is the forward velocity linear.x, m/s, the left velocity linear.y, m/s, and the yaw rate angular.z, rad/s.
"""
RESET = "/reset"
"""Subscribed topic of type std_msgs/Empty: each message resets the robot and starts a new episode."""
JOINT_STATES = "/joint_states"
"""Published topic of type sensor_msgs/JointState: joint angles, rad, velocities, rad/s, and torques, N·m."""
IMU = "/imu"
"""Published topic of type sensor_msgs/Imu: orientation, angular velocity and specific force of the trunk.

Angular velocity, rad/s, and specific force, m/s², are in the base frame.
"""
CLOCK = "/clock"
"""Published topic of type rosgraph_msgs/Clock: simulated time since the start of the simulation."""
JOINT_STATE_PERIOD = 0.02
"""Time between two messages of the topic JOINT_STATES, s; the other topics have a message at every control step."""
NODE = "simple_quad"
"""Name under which the simulated robot registers as a ROS node."""
MAX_NUMBERS = 256
"""Maximum number of joint targets that the node passes from a ROS message to the simulation.

No robot accepts a longer message. Of a longer message, the node passes on only the number of joint targets, so that the
simulation can report the error.
"""
MAX_PACKET_SIZE = 65_536
"""Maximum size of a packet between the ROS process and the simulation, bytes."""


def main(version: str, joints: list[str]) -> None:
    """Run the ROS process: start a node, and exchange messages until the simulation closes the socket.

    Args:
        version: Version of ROS, `1` or `2`.
        joints: Names of the robot's joints, in the order of the joint targets.
    """
    link = socket.socket(fileno=os.dup(0))
    try:
        transport = _transport(version)(NODE, lambda why: _send_packet(link, {"ended": why}))
    except OSError as error:
        _send_packet(link, {"ended": str(error)})
        return
    Node(link, transport, joints).run()
    transport.close()
    os._exit(0)  # The process must end even if threads of ROS still run.


def _transport(version: str) -> Any:
    """Return the class of the node for a version of ROS: `Ros1` for `1`, `Ros2` for `2`."""
    if version == "1":
        from live.ros.ros1 import Ros1

        return Ros1
    from live.ros.ros2 import Ros2

    return Ros2


class Node:
    """Converts packets from the simulation to ROS messages, and received ROS messages to packets.

    A packet is a JSON object that the processes exchange over a socket.

    Args:
        link: Socket to the simulation.
        transport: Node of ROS 1 or ROS 2, which sends and receives the messages.
        joints: Names of the robot's joints, in the order of the joint readings.
    """

    def __init__(self, link: socket.socket, transport: Any, joints: list[str]) -> None:
        from geometry_msgs.msg import Twist
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import Imu, JointState
        from std_msgs.msg import Empty, Float64MultiArray

        self._link = link
        self._stamp = transport.stamp
        self._joints = joints
        self._message_types = {CLOCK: Clock, IMU: Imu, JOINT_STATES: JointState}
        self._publish = {topic: transport.publisher(topic, kind) for topic, kind in self._message_types.items()}
        transport.subscribe(JOINT_TARGETS, Float64MultiArray, self._receive_joint_targets)
        transport.subscribe(VELOCITY, Twist, self._receive_velocity)
        transport.subscribe(RESET, Empty, lambda message: self._forward(RESET, [], 0))
        _send_packet(link, {"ready": transport.where})

    def run(self) -> None:
        """Publish the readings in each packet from the simulation until the simulation closes the socket."""
        while True:
            try:
                data = self._link.recv(MAX_PACKET_SIZE)
            except ConnectionResetError:
                return
            if not data:
                return
            self._publish_packet(json.loads(data))

    def _publish_packet(self, packet: dict[str, Any]) -> None:
        """Publish the contents of a packet from the simulation as ROS messages.

        A packet has the simulated time and the IMU readings, and in some control steps the joint readings.
        """
        stamp = self._stamp(packet["time"])
        clock = self._message_types[CLOCK]()
        clock.clock = stamp
        self._publish[CLOCK](clock)
        imu = self._message(IMU, stamp)
        reading = packet[IMU]
        # The scalar part w of a quaternion is first in the simulation and last in ROS.
        w, x, y, z = reading["quaternion"]
        imu.orientation.x = x
        imu.orientation.y = y
        imu.orientation.z = z
        imu.orientation.w = w
        for vector, name in ((imu.angular_velocity, "angular_velocity"), (imu.linear_acceleration, "specific_force")):
            vector.x, vector.y, vector.z = reading[name]
        self._publish[IMU](imu)
        if JOINT_STATES in packet:
            reading = packet[JOINT_STATES]
            state = self._message(JOINT_STATES, stamp)
            state.name = self._joints
            state.position = reading["position"]
            state.velocity = reading["velocity"]
            state.effort = reading["torque"]
            self._publish[JOINT_STATES](state)

    def _message(self, topic: str, stamp: Any) -> Any:
        """Return an empty ROS message for a topic; its header has the time `stamp` and the frame base_link."""
        message = self._message_types[topic]()
        message.header.stamp = stamp
        message.header.frame_id = "base_link"
        return message

    def _receive_joint_targets(self, message: Any) -> None:
        """Send the joint targets of a received ROS message to the simulation."""
        size = len(message.data)
        self._forward(JOINT_TARGETS, list(message.data) if size <= MAX_NUMBERS else [], size)

    def _receive_velocity(self, message: Any) -> None:
        """Send the velocity command of a received ROS message to the simulation."""
        self._forward(VELOCITY, [message.linear.x, message.linear.y, message.angular.z], 3)

    def _forward(self, topic: str, values: list[float], size: int) -> None:
        """Send a received ROS message to the simulation: its topic, its numbers, `values`, and their count, `size`."""
        _send_packet(self._link, {"topic": topic, "values": values, "size": size})


def _send_packet(link: socket.socket, packet: dict[str, Any]) -> None:
    """Send a packet as JSON to the simulation; end this process if the simulation has ended."""
    try:
        link.send(json.dumps(packet).encode())
    except OSError:  # The simulation has ended, and so its end of the socket is closed.
        os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
