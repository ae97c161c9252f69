"""A robot behind ROS 1 marches like the article's controller, and no ROS message makes it fall."""

import contextlib
import http.client
import os
import socket
import xmlrpc.client
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from live.ros import interpreter
from live.ros.ros_process import RosProcess, RosProcessError
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.live.ros.robot import Robot, Walk, free_port, march, python_with_ros, received, recorded

CYCLE = 50
"""Number of control steps of a gait cycle of the article's controller."""
FOLLOWED, SILENT = "/position_controller/command is followed", "nothing good on /position_controller/command"


@dataclass(frozen=True)
class Story:
    """Record of a robot that marched, lost its node, and then received malformed messages."""

    walk: Walk
    said: str
    code: int
    table: np.ndarray
    """Targets of `document_repaired`, as published by the node."""
    received: Path


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Story:
    folder = tmp_path_factory.mktemp("story")
    table = march(folder / "table")
    # Simulated time is slower than wall time, because the cores may be busy: 0.2 s of silence are 0.33 s of wall time.
    robot = Robot(folder, "--record", str(folder / "walk.mcap"), "--real-time-factor", "0.6")
    try:
        robot.wait_for("Ctrl-C ends it")
        listening = robot.node("listen", "4", str(folder / "received"))
        marching = robot.node("march", str(folder / "table"), "sim")
        robot.wait_for(FOLLOWED)
        assert listening.wait(30) == 0
        marching.kill()
        marching.wait()
        robot.wait_for(SILENT)
        assert robot.node("malformed").wait(60) == 0
        robot.wait_for(FOLLOWED, 2)
        robot.wait_for(SILENT, 2)
        code = robot.end()
    finally:
        robot.process.kill()
        robot.process.wait()
    return Story(recorded(folder / "walk.mcap"), robot.said, code, table, folder / "received")


def test_the_robot_marches_as_the_node_has_it_and_stands_up_once_that_is_killed(story: Story) -> None:
    targets = story.walk.targets
    # The robot follows the targets from here on.
    begin = int(np.flatnonzero(np.any(targets != targets[0], axis=1))[0]) + CYCLE
    marched = slice(begin, begin + 4 * CYCLE)
    published = np.clip(story.table, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper).astype(np.float32)
    assert {tuple(row) for row in targets[marched].tolist()} <= {tuple(row) for row in published.tolist()}
    lifts = story.walk.feet[marched].reshape(-1, CYCLE, 4).max(axis=1).mean(axis=0) - SIMPLE_QUAD.foot_radius  # m
    assert (lifts[:2] > 0.1).all()
    home = begin + int(np.flatnonzero(np.all(np.abs(targets[begin:] - SIMPLE_QUAD.home_pose) < 1e-5, axis=1))[0])
    standing = story.walk.joints[home + 50 : home + 60]
    np.testing.assert_allclose(standing, np.tile(SIMPLE_QUAD.home_pose, (10, 1)), atol=0.06)
    assert "fallen" not in story.said


def test_nonsense_is_refused_and_the_simulation_goes_on_to_follow_what_is_good(story: Story) -> None:
    lines = story.said.splitlines()
    for reason in ("not 12 numbers", "not finite"):
        assert sum(f"/position_controller/command: refused, {reason}" in line for line in lines) == 1
    assert story.code == 130
    assert "Traceback" not in story.said
    assert np.isfinite(story.walk.joints).all()
    assert story.walk.trunk[-1] > 0.4


def test_joint_states_come_at_50_hz_in_the_robots_order_beside_the_clock(story: Story) -> None:
    states, clocks, imus = (received(story.received, topic) for topic in ("/joint_states", "/clock", "/imu"))
    assert len(states) > 20
    assert set(np.diff([state["stamp"] for state in states])) == {20_000_000}
    assert set(np.diff([imu["stamp"] for imu in imus])) == {10_000_000}
    # rospy itself skips a late /clock, if nodes use it.
    ticks = np.diff([clock["stamp"] for clock in clocks])
    assert set(ticks % 10_000_000) == {0}
    assert np.median(ticks) == 10_000_000
    for state in states[::10]:
        step = round(state["stamp"] / 1e7) - 1
        assert state["name"] == list(SIMPLE_QUAD.joint_names)
        np.testing.assert_allclose(state["position"], story.walk.joints[step], atol=1e-9)
    for imu in imus[::10]:
        np.testing.assert_allclose(imu["turn"], story.walk.turns[round(imu["stamp"] / 1e7) - 1], atol=1e-9)
    np.testing.assert_allclose(np.mean([imu["force"] for imu in imus], axis=0), [0.0, 0.0, 9.81], atol=2.0)


def refused(address: str, port: int) -> bool:
    try:
        socket.create_connection((address, port), timeout=5).close()
    except ConnectionRefusedError:
        return True
    return False


@pytest.fixture(scope="module")
def address() -> str:
    """Return an address of this machine outside the loopback interface; skip the test without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends no data
        except OSError as error:
            pytest.skip(f"this machine has the loopback interface alone: {error}")
        return str(probe.getsockname()[0])


def check_reach(robot: Robot, address: str, network: bool) -> None:
    ports = robot.ports()
    assert robot.port in ports
    assert len(ports) == 3  # the addresses of the master, of the node, and of its messages
    assert [refused(address, port) for port in ports] == 3 * [not network]
    assert [refused("127.0.0.1", port) for port in ports] == 3 * [False]


def test_velocities_steer_a_policy_and_others_are_kept_out(address: str, tmp_path: Path) -> None:
    steered = Robot(tmp_path, "--policy", "trot", "--record", str(tmp_path / "walk.mcap"), ROS_IP=address)
    try:
        steered.wait_for("Ctrl-C ends it")
        listening = steered.node("listen", "4", str(tmp_path / "received"))
        assert steered.node("steer").wait(30) == 0
        steered.wait_for("reset, seed 1")
        steered.wait_for("nothing good on /cmd_vel for 0.5 s: the command is zero")
        assert listening.wait(30) == 0
        assert received(tmp_path / "received", "/joint_states")
        check_reach(steered, address, network=False)

        with xmlrpc.client.ServerProxy(f"http://127.0.0.1:{steered.port}") as master:
            _, _, node = master.lookupNode("/test", "/simple_quad")
        for port in (steered.port, int(node.rstrip("/").rpartition(":")[2])):
            call = xmlrpc.client.dumps(("/test",), "getPid")
            for headers, status in (({}, 200), ({"Origin": "http://a-page.example"}, 403)):
                connection = http.client.HTTPConnection("127.0.0.1", port)
                connection.request("POST", "/", call, headers)
                assert connection.getresponse().status == status
                connection.close()

        # rosnode kill, or another node with the same name; the node may end before its answer.
        with contextlib.suppress(OSError, http.client.HTTPException), xmlrpc.client.ServerProxy(node) as slave:
            slave.shutdown("/test", "for a test")
        assert steered.process.wait(30) == 2
    finally:
        steered.process.kill()
        steered.process.wait()
    assert "error: ROS has ended the node" in steered.said
    assert "Traceback" not in steered.said
    commands = {tuple(command) for command in recorded(tmp_path / "walk.mcap").commands.tolist()}
    assert commands == {(0.0, 0.0, 0.0), (0.3, -0.1, 0.2)}


def test_other_interfaces_reach_it_if_it_is_let_onto_the_network(address: str, tmp_path: Path) -> None:
    robot = Robot(tmp_path, "--network", ROS_IP=address)
    try:
        robot.wait_for("Ctrl-C ends it")
        check_reach(robot, address, network=True)
        assert robot.end() == 130
    finally:
        robot.process.kill()
        robot.process.wait()


def test_a_port_that_something_else_listens_on_is_a_line() -> None:
    python = python_with_ros("1")
    with socket.socket() as other:
        other.bind(("127.0.0.1", port := free_port()))
        other.listen()
        variables = dict(os.environ) | {"ROS_MASTER_URI": f"http://localhost:{port}"}
        command = [python, "-m", "live.ros.node", "1"]
        with (
            closing(RosProcess(command, interpreter.environment(variables, network=False))) as link,
            pytest.raises(RosProcessError, match="no ROS master answers at"),
        ):
            link.wait_until_ready()
