"""Where ROS is found, on which interface it listens, and mistakes at the command line; none of it needs ROS."""

import os
import sys
from collections.abc import Callable
from contextlib import closing

import pytest

from live.ros import interpreter
from live.ros.link import Link, LinkLost
from quad_env.__main__ import main


def test_without_ros_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]) -> None:
    monkeypatch.setattr(interpreter, "MODULES", ("json", "no_such_rclpy"))
    said = refused(main, "ros")
    assert said.startswith("error: no Python here has ROS 2")
    assert "source its setup.bash; ROS 1 is gone, revision 02bbde28 has it" in said
    monkeypatch.setattr(interpreter, "MODULES", ("json", "socket"))
    assert os.access(interpreter.find(), os.X_OK)


def test_the_node_listens_on_this_machine_alone_whatever_is_sourced() -> None:
    sourced = {"ROS_DOMAIN_ID": "3", "ROS_LOCALHOST_ONLY": "0"}
    found = interpreter.environment(sourced | {"PYTHONPATH": "/opt/ros"}, network=False)
    assert found["ROS_DOMAIN_ID"] == "3"
    assert (found["ROS_LOCALHOST_ONLY"], found["ROS_AUTOMATIC_DISCOVERY_RANGE"]) == ("1", "LOCALHOST")
    assert found["PYTHONPATH"].split(os.pathsep)[0] == "/opt/ros"
    assert sourced.items() <= interpreter.environment(sourced, network=True).items()


READY = 'import socket, time; link = socket.socket(fileno=0); link.send(b\'{"ready": "here"}\'); '


def test_a_process_that_does_not_keep_up_is_not_waited_for_and_one_that_ends_is_noticed() -> None:
    with closing(Link([sys.executable, "-c", READY + "link.recv(100)"], os.environ)) as link:
        assert link.wait_until_ready() == "here"
        assert list(link.received()) == []
        for _ in range(2000):
            link.send({"values": [0.0] * 100})  # it does not keep up, and is not waited for
        link._process.wait(60)
        link.send({"time": 2})  # to nobody
        with pytest.raises(LinkLost, match="has ended"):
            list(link.received())
