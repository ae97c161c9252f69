"""Search for ROS, its network interface, and errors on the command line; these tests do not need ROS."""

import os
import sys
from collections.abc import Callable
from contextlib import closing

import pytest

from live.ros import interpreter
from live.ros.ros_process import RosProcess, RosProcessError
from quad_env.__main__ import main
from quad_env.cli.command_line import UsageError


def test_without_ros_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]) -> None:
    monkeypatch.setattr(interpreter, "REQUIRED_MODULES", {"1": ("json", "no_such_rospy"), "2": ("no_such_rclpy",)})
    monkeypatch.delenv("ROS_VERSION", raising=False)
    said = refused(main, "ros")
    assert said.startswith("error: no Python here has ROS 1 or ROS 2")
    assert "apt-get install python3-rospy" in said


def test_the_version_that_is_sourced_or_asked_for_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interpreter, "REQUIRED_MODULES", {"1": ("json",), "2": ("socket", "json")})
    monkeypatch.delenv("ROS_VERSION", raising=False)
    assert interpreter.find(None)[0] == "1"
    monkeypatch.setenv("ROS_VERSION", "2")
    assert interpreter.find(None)[0] == "2"
    assert interpreter.find("1")[0] == "1"


def test_the_node_listens_on_this_machine_alone_whatever_is_sourced() -> None:
    sourced = {"ROS_IP": "10.0.0.5", "ROS_HOSTNAME": "robot", "ROS_IPV6": "on", "ROS_LOCALHOST_ONLY": "0"}
    found = interpreter.environment(sourced | {"PYTHONPATH": "/opt/ros"}, network=False)
    assert found["ROS_IP"] == "127.0.0.1"
    assert "ROS_HOSTNAME" not in found
    assert "ROS_IPV6" not in found
    assert (found["ROS_LOCALHOST_ONLY"], found["ROS_AUTOMATIC_DISCOVERY_RANGE"]) == ("1", "LOCALHOST")
    assert found["PYTHONPATH"].split(os.pathsep)[0] == "/opt/ros"
    assert sourced.items() <= interpreter.environment(sourced, network=True).items()


@pytest.mark.parametrize("uri", ["http://10.0.0.5:11311", "http://localhost.example:11311"])
def test_a_master_on_another_machine_needs_the_network(uri: str) -> None:
    with pytest.raises(UsageError, match="--network"):
        interpreter.environment({"ROS_MASTER_URI": uri}, network=False)
    for here in ("http://localhost:11311", "http://127.0.0.1:11311/"):
        assert interpreter.environment({"ROS_MASTER_URI": here}, network=False)["ROS_MASTER_URI"] == here
    assert interpreter.environment({"ROS_MASTER_URI": uri}, network=True)["ROS_MASTER_URI"] == uri


READY = 'import socket, time; link = socket.socket(fileno=0); link.send(b\'{"ready": "here"}\'); '


def test_a_process_that_does_not_keep_up_is_not_waited_for_and_one_that_ends_is_noticed() -> None:
    with closing(RosProcess([sys.executable, "-c", READY + "link.recv(100)"], os.environ)) as link:
        assert link.wait_until_ready() == "here"
        assert list(link.received()) == []
        for _ in range(2000):
            link.send({"values": [0.0] * 100})  # the receiver does not keep up, and the sender does not wait
        link._process.wait(60)
        link.send({"time": 2})  # without a receiver
        with pytest.raises(RosProcessError, match="has ended"):
            list(link.received())
