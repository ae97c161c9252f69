"""The same robot behind ROS 2; only the connection differs from ROS 1."""

from pathlib import Path

import numpy as np

from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.live.ros.robot import Robot, march, received, recorded


def test_a_node_of_ros_2_marches_and_receives_what_the_robot_does(tmp_path: Path) -> None:
    march(tmp_path / "table")
    robot = Robot(tmp_path, "--record", str(tmp_path / "walk.mcap"), version="2")
    try:
        robot.wait_for("Ctrl-C ends it")
        assert robot.node("march_ros2", str(tmp_path / "table"), "2", str(tmp_path / "received")).wait(30) == 0
        robot.wait_for("nothing good on /position_controller/command")
        robot.wait_for("reset, seed 1")
        assert robot.end() == 130
    finally:
        robot.process.kill()
        robot.process.wait()
    walk = recorded(tmp_path / "walk.mcap")
    assert np.ptp(walk.feet[:, :2], axis=0).min() > 0.1
    states, imus, clocks = (received(tmp_path / "received", topic) for topic in ("/joint_states", "/imu", "/clock"))
    assert set(np.diff([state["stamp"] for state in states])) == {20_000_000}
    assert set(np.diff([clock["stamp"] for clock in clocks])) == {10_000_000}
    for state, imu in zip(states[::10], imus[::20], strict=False):
        assert state["name"] == list(SIMPLE_QUAD.joint_names)
        np.testing.assert_allclose(state["position"], walk.joints[round(state["stamp"] / 1e7) - 1], atol=1e-9)
        np.testing.assert_allclose(imu["turn"], walk.turns[round(imu["stamp"] / 1e7) - 1], atol=1e-9)
    assert "/position_controller/command: refused, not 12 numbers" in robot.said
    assert "/cmd_vel: refused" in robot.said
    assert "Traceback" not in robot.said
