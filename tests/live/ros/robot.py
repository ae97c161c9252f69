"""The command `python -m quad_env ros` in a test, with nodes that use only ROS."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import policies
from live.ros import interpreter
from quad_env.cli.command_line import UsageError
from quad_env.physics.state import rotation_matrix
from quad_env.robots.kinematics import feet_in_world
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.live.decoded import read_mcap

Node = subprocess.Popen[bytes]
NODES = Path(__file__).with_name("nodes")
TIMEOUT = 60.0


def python_with_ros(version: str) -> str:
    """Return the Python with a version of ROS; skip the test without one."""
    try:
        return interpreter.find(version)[1]
    except UsageError as error:
        pytest.skip(str(error))


def free_port() -> int:
    """Return a free port of the loopback interface."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def march(path: Path) -> np.ndarray:
    """Write joint targets of `document_repaired`, an open-loop controller, into a file for nodes.

    The function returns the targets, (n, 12), rad.
    """
    policy, shown = policies.make("document_repaired"), np.zeros(48, np.float32)
    policy.reset()
    targets = np.array([policy.act(shown) for _ in range(1000)])
    path.write_text(json.dumps(targets.tolist()), encoding="utf-8")
    return targets


class Robot:
    """The command, with its own master on a free port, or in its own domain."""

    def __init__(
        self, folder: Path, *options: str, version: str = "1", port: int | None = None, **variables: str
    ) -> None:
        self.python, self.port = python_with_ros(version), port or free_port()
        home = {
            "ROS_HOME": str(folder / "ros"),
            "ROS_MASTER_URI": f"http://localhost:{self.port}",
            "ROS_DOMAIN_ID": str(1 + self.port % 100),
        }
        others = {name: value for name, value in os.environ.items() if not name.startswith("ROS_")}
        self.environment = others | home | variables
        self._said = folder / "said"
        with self._said.open("w", encoding="utf-8") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "quad_env", "ros", "--version", version, *options],
                stdout=said,
                stderr=subprocess.STDOUT,
                env=self.environment,
                process_group=0,
            )

    @property
    def said(self) -> str:
        """Text that the command has printed."""
        return self._said.read_text(encoding="utf-8")

    def wait_for(self, text: str, count: int = 1) -> None:
        """Wait until the command has printed a text `count` times."""
        end = time.monotonic() + TIMEOUT
        while self.said.count(text) < count:
            assert time.monotonic() < end, f"{text!r} was not said: {self.said}"
            assert self.process.poll() is None, f"it ended: {self.said}"
            time.sleep(0.02)

    def node(self, name: str, *arguments: str) -> Node:
        """Run a node of `nodes` with the Python that has ROS."""
        command = [self.python, str(NODES / f"{name}.py"), *arguments]
        here = {"ROS_IP": "127.0.0.1", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        return subprocess.Popen(command, env=self.environment | here, stderr=subprocess.DEVNULL)

    def ports(self) -> list[int]:
        """Return the listening ports of the process that uses ROS."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        (child,) = children.read_text(encoding="utf-8").split()[:1]
        inodes = {os.readlink(entry) for entry in Path(f"/proc/{child}/fd").iterdir()}
        rows = [line.split() for line in Path("/proc/net/tcp").read_text(encoding="utf-8").splitlines()[1:]]
        return [int(row[1].partition(":")[2], 16) for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in inodes]

    def end(self) -> int:
        """End the command by Ctrl-C, sent to all of its processes as a terminal does, and return the exit code."""
        os.killpg(self.process.pid, signal.SIGINT)
        return self.process.wait(TIMEOUT)


@dataclass(frozen=True)
class Walk:
    """Record of a walk, one row per control step."""

    targets: np.ndarray
    joints: np.ndarray
    feet: np.ndarray
    """Heights of the centres of the feet, m."""
    trunk: np.ndarray
    """Height of the centre of the trunk, m."""
    commands: np.ndarray
    turns: np.ndarray
    """Orientation of the trunk, quaternion x y z w."""


def recorded(path: Path) -> Walk:
    """Return the walk in a file of --record."""
    decoded = {topic: [content for _, content in messages] for topic, messages in read_mcap(path).items()}
    trunk = [frame.transforms[0].transform for frame in decoded["/tf"][1:]]
    joints = np.array([state.position for state in decoded["/joint_states"][1:]])
    places = np.array([[getattr(each.translation, axis) for axis in "xyz"] for each in trunk])
    turns = np.array([[getattr(each.rotation, name) for name in "xyzw"] for each in trunk])
    rotations = np.moveaxis(np.array(rotation_matrix(tuple(np.roll(turns, 1, axis=1).T))), -1, 0)
    return Walk(
        np.array([list(message.data) for message in decoded["/position_controller/command"]]),
        joints,
        feet_in_world(SIMPLE_QUAD, places, rotations, joints)[..., 2],
        places[:, 2],
        np.array([(twist.linear.x, twist.linear.y, twist.angular.z) for twist in decoded["/cmd_vel"]]),
        turns,
    )


def received(path: Path, topic: str) -> list[dict[str, list[float]]]:
    """Return the messages of a topic that `nodes/listen.py` wrote."""
    return [fields for name, _, fields in json.loads(path.read_text(encoding="utf-8")) if name == topic]
