"""The same robot behind ROS 2, which shares all but its connection with ROS 1."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import policies
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.live.ros.robot import Robot, heard, recorded

STRANGER, HERE, THERE = "quad-stranger", "10.213.77.1", "10.213.77.2"
"""A network namespace: another machine as far as sockets go; and the two ends of the cable to it."""
PLAIN_UDP = """<?xml version="1.0"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<transport_descriptors><transport_descriptor><transport_id>u</transport_id><type>UDPv4</type></transport_descriptor>
</transport_descriptors><participant profile_name="p" is_default_profile="true"><rtps><userTransports>
<transport_id>u</transport_id></userTransports><useBuiltinTransports>false</useBuiltinTransports></rtps></participant>
</profiles>"""


@pytest.fixture
def table(tmp_path: Path) -> str:
    """File with joint targets of `document_repaired`."""
    policy = policies.make("document_repaired")
    policy.reset()
    shown = np.zeros(48, np.float32)
    (tmp_path / "table").write_text(json.dumps([policy.act(shown).tolist() for _ in range(1000)]), encoding="utf-8")
    return str(tmp_path / "table")


def test_a_node_of_ros_2_marches_and_hears_what_the_robot_does(table: str, tmp_path: Path) -> None:
    robot = Robot(tmp_path, "--record", str(tmp_path / "walk.mcap"), version="2")
    try:
        robot.wait_for("Ctrl-C ends it")
        assert robot.node("march_ros2", table, "2", str(tmp_path / "heard")).wait(30) == 0
        robot.wait_for("nothing good on /position_controller/command")
        robot.wait_for("reset, seed 1")
        assert robot.end() == 130
    finally:
        robot.process.kill()
    walk = recorded(tmp_path / "walk.mcap")
    assert np.ptp(walk.feet[:, :2], axis=0).min() > 0.1
    states, imus, clocks = (heard(tmp_path / "heard", topic) for topic in ("/joint_states", "/imu", "/clock"))
    assert set(np.diff([state["stamp"] for state in states])) == {20_000_000}
    assert set(np.diff([clock["stamp"] for clock in clocks])) == {10_000_000}
    for state, imu in zip(states[::10], imus[::20], strict=False):
        assert state["name"] == list(SIMPLE_QUAD.joint_names)
        np.testing.assert_allclose(state["position"], walk.joints[round(state["stamp"] / 1e7) - 1], atol=1e-9)
        np.testing.assert_allclose(imu["turn"], walk.turns[round(imu["stamp"] / 1e7) - 1], atol=1e-9)
    assert "/position_controller/command: 20 messages refused, not 12 numbers" in robot.said
    assert "/cmd_vel: 20 messages refused" in robot.said
    assert "Traceback" not in robot.said


@pytest.fixture
def stranger() -> Iterator[tuple[str, ...]]:
    """What runs a command on another machine, as far as sockets go."""

    def ip(*words: str) -> None:
        subprocess.run(["ip", *words], check=True, capture_output=True)

    try:
        ip("netns", "add", STRANGER)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"no network namespace can be made here: {error}")
    try:
        ip("link", "add", "quad0", "type", "veth", "peer", "name", "quad1", "netns", STRANGER)
        ip("addr", "add", f"{HERE}/24", "dev", "quad0")
        ip("link", "set", "quad0", "up")
        ip("-n", STRANGER, "addr", "add", f"{THERE}/24", "dev", "quad1")
        ip("-n", STRANGER, "link", "set", "quad1", "up")
        ip("-n", STRANGER, "link", "set", "lo", "up")
        yield ("ip", "netns", "exec", STRANGER)
    finally:
        ip("netns", "del", STRANGER)


@pytest.mark.parametrize("network", [False, True])
def test_another_machine_reaches_it_if_it_is_let_onto_the_network_alone(
    network: bool, table: str, stranger: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "udp").write_text(PLAIN_UDP, encoding="utf-8")
    robot = Robot(tmp_path, *(["--network"] if network else []), version="2")
    try:
        robot.wait_for("Ctrl-C ends it")
        discovery = {"ROS_STATIC_PEERS": HERE, "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
        variables = discovery | {"FASTRTPS_DEFAULT_PROFILES_FILE": str(tmp_path / "udp")}
        node = robot.node("march_ros2", table, "2", str(tmp_path / "heard"), before=stranger, **variables)
        assert node.wait(30) == 0
        assert robot.end() == 130
    finally:
        robot.process.kill()
    assert (len(heard(tmp_path / "heard", "/clock")) > 50) == network
    assert ("/position_controller/command is followed" in robot.said) == network
