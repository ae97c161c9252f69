"""The node between packets and messages, with stand-ins for ROS and its messages."""

import json
import socket
import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from live.ros import node


class Blank:
    """A message: whatever is asked of it is there."""

    def __getattr__(self, name: str) -> Any:
        vars(self)[name] = Blank()
        return vars(self)[name]


class Transport:
    """A ROS that keeps what is published, and who takes what."""

    where = "here"
    stamp = staticmethod(lambda nanoseconds: nanoseconds)

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []
        self.takes: dict[str, Callable[[Any], None]] = {}

    def publisher(self, topic: str, _: Any) -> Callable[[Any], None]:
        return lambda message: self.published.append((topic, message))

    def subscribe(self, topic: str, _: Any, take: Callable[[Any], None]) -> None:
        self.takes[topic] = take


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Transport:
    for package in ("geometry_msgs", "rosgraph_msgs", "sensor_msgs", "std_msgs"):
        messages = ModuleType(f"{package}.msg")
        vars(messages).update(
            dict.fromkeys(("Twist", "Clock", "Imu", "JointState", "Empty", "Float64MultiArray"), Blank)
        )
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, f"{package}.msg", messages)
    return Transport()


def test_packets_become_messages_and_messages_packets(ros: Transport) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        it = node.Node(theirs, ros, ["a", "b"])
        imu = {"quaternion": [1.0, 0.1, 0.2, 0.3], "angular_velocity": [1, 2, 3], "specific_force": [0, 0, 9.81]}
        states = {"position": [0.1, 0.2], "velocity": [1.0, 2.0], "torque": [3.0, 4.0]}
        ours.send(json.dumps({"time": 20_000_000, node.IMU: imu, node.JOINT_STATES: states}).encode())
        ros.takes[node.JOINT_TARGETS](SimpleNamespace(data=[0.5] * 2))
        ros.takes[node.JOINT_TARGETS](SimpleNamespace(data=[0.5] * (node.LARGEST + 1)))
        linear, angular = SimpleNamespace(x=0.3, y=-0.1), SimpleNamespace(z=0.2)
        ros.takes[node.VELOCITY](SimpleNamespace(linear=linear, angular=angular))
        ros.takes[node.RESET](None)
        said = [json.loads(ours.recv(node.LARGEST_PACKET)) for _ in range(5)]
        ours.shutdown(socket.SHUT_WR)
        it.run()
    assert said[0] == {"ready": "here"}
    assert [(each["topic"], each["values"], each["size"]) for each in said[1:]] == [
        (node.JOINT_TARGETS, [0.5, 0.5], 2),
        (node.JOINT_TARGETS, [], node.LARGEST + 1),
        (node.VELOCITY, [0.3, -0.1, 0.2], 3),
        (node.RESET, [], 0),
    ]
    (_, clock), (_, given), (_, state) = ros.published
    assert [topic for topic, _ in ros.published] == [node.CLOCK, node.IMU, node.JOINT_STATES]
    assert clock.clock == given.header.stamp == 20_000_000
    turn = given.orientation
    assert (turn.w, turn.x, turn.y, turn.z) == (1.0, 0.1, 0.2, 0.3)
    assert (given.angular_velocity.z, given.linear_acceleration.z, given.header.frame_id) == (3, 9.81, "base_link")
    assert (state.name, state.position, state.velocity, state.effort) == (["a", "b"], *states.values())
