"""Node of ROS 2 that marches and listens: `march_ros2.py TABLE.json SECONDS FILE`, with the file format of `listen.py`.

The time starts with the first message; the node waits at most twice this time for it.
"""

import json
import sys
import time
from pathlib import Path

import rclpy
from geometry_msgs.msg import Twist
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Empty, Float64MultiArray

rclpy.init()
node = rclpy.create_node("march")
received = []
targets = iter(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))


def stamp(time: object) -> int:
    return time.sec * 10**9 + time.nanosec


def on_clock(clock: Clock) -> None:
    received.append(["/clock", time.time(), {"stamp": stamp(clock.clock)}])
    publisher.publish(Float64MultiArray(data=next(targets)))


def on_imu(imu: Imu) -> None:
    turn, force = imu.orientation, imu.linear_acceleration
    reading = {"turn": [turn.x, turn.y, turn.z, turn.w], "force": [force.x, force.y, force.z]}
    received.append(["/imu", time.time(), {"stamp": stamp(imu.header.stamp), **reading}])


def on_joint_states(state: JointState) -> None:
    reading = {name: list(getattr(state, name)) for name in ("name", "position", "velocity", "effort")}
    received.append(["/joint_states", time.time(), {"stamp": stamp(state.header.stamp), **reading}])


publisher = node.create_publisher(Float64MultiArray, "/position_controller/command", 10)
velocity = node.create_publisher(Twist, "/cmd_vel", 10)
reset = node.create_publisher(Empty, "/reset", 10)
node.create_subscription(Imu, "/imu", on_imu, 10)
node.create_subscription(JointState, "/joint_states", on_joint_states, 10)
node.create_subscription(Clock, "/clock", on_clock, 10)
seconds = float(sys.argv[2])
end = time.monotonic() + 2.0 * seconds
while not received and time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
end = time.monotonic() + seconds * bool(received)
while time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
Path(sys.argv[3]).write_text(json.dumps(received), encoding="utf-8")
for _ in range(20):
    velocity.publish(Twist())
    publisher.publish(Float64MultiArray(data=[0.0] * 11))
    time.sleep(0.01)
reset.publish(Empty())
time.sleep(0.3)
