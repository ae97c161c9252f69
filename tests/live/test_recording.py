"""Recordings equal the simulation, decoded by a library independent of the writer."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2.metadata import parse_qos

import policies
import quad_env
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from live.recording import recorder
from live.recording.messages import STANDARD_TOPICS, topic_name
from live.recording.recorder import recorder_for
from quad_env.physics.state import rotation_matrix
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.live.decoded import Decoded, events_of, read_mcap
from tests.waiting import until

STEPS = 130


class Recording(NamedTuple):
    """An episode and its decoded recording."""

    steps: list[Step]
    decoded: Decoded
    file: Path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder, steps, walker = tmp_path_factory.mktemp("recording"), [], policies.make("residual")
    file = folder / "walk.mcap"
    with recorder_for(file, walker) as observer:
        push = quad_env.scenario("push=42")
        roll_out(walker, push, np.array([3]), observer, steps.append, steps=STEPS)
    return Recording(steps, read_mcap(file), file)


def test_joint_states_targets_and_commands_are_those_of_every_step(recording: Recording) -> None:
    steps, decoded, *_ = recording
    assert [stamp for stamp, _ in decoded["/joint_states"]] == [10_000_000 * number for number in range(STEPS + 1)]
    for step, (stamp, state) in zip(steps, decoded["/joint_states"], strict=True):
        assert state.name == list(SIMPLE_QUAD.joint_names)
        assert list(state.position) == step.infos["joint_position"][0].tolist()
        assert list(state.velocity) == step.infos["joint_velocity"][0].tolist()
        assert list(state.effort) == step.infos["joint_torque"][0].tolist()
        assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == stamp
    assert [clock.clock.nanosec for _, clock in decoded["/clock"]][:3] == [0, 10_000_000, 20_000_000]
    given = decoded["/position_controller/command"]
    assert [stamp for stamp, _ in given] == [10_000_000 * number for number in range(STEPS)]
    for step, (_, targets), (_, twist) in zip(steps[1:], given, decoded["/cmd_vel"], strict=True):
        assert list(targets.data) == step.infos["action"][0].tolist()
        assert (twist.linear.x, twist.linear.y, twist.angular.z) == tuple(step.infos["command"][0])


def test_the_trunk_turns_as_ros_writes_it_and_every_link_of_the_urdf_has_a_frame(recording: Recording) -> None:
    steps, decoded, *_ = recording
    [(at, fixed)] = decoded["/tf_static"]
    assert at == 0
    for step, (_, frames) in list(zip(steps, decoded["/tf"], strict=True))[::10]:
        trunk, *links = frames.transforms
        turn = trunk.transform.rotation
        assert (turn.w, turn.x, turn.y, turn.z) == tuple(step.infos["quaternion"][0])
        assert (trunk.header.frame_id, trunk.child_frame_id) == ("world", "base_link")
    names = {frame.child_frame_id for frame in (trunk, *links, *fixed.transforms)}
    urdf = ElementTree.fromstring(decoded["/robot_description"][0][1].data)
    assert {link.get("name") for link in urdf.iter("link")} == names


def test_the_imu_measures_its_own_weight_and_every_change_of_its_velocity(recording: Recording) -> None:
    steps, decoded, *_ = recording
    felt = np.array([[getattr(imu.linear_acceleration, axis) for axis in "xyz"] for _, imu in decoded["/imu"]])
    turns = np.array([[getattr(imu.angular_velocity, axis) for axis in "xyz"] for _, imu in decoded["/imu"]])
    assert turns.tolist() == [step.infos["angular_velocity"][0].tolist() for step in steps]
    # Positions come from the simulation, independent of the IMU.
    places = np.array([step.infos["position"][0] for step in steps])
    means = (places[1:] - places[:-1]) / 0.01  # mean velocities over the steps
    turned = [np.array(rotation_matrix(step.infos["quaternion"][0])) for step in steps]
    forces = np.array([rotation @ force for rotation, force in zip(turned, felt, strict=True)])
    # Change of the velocities at the ends of the steps.
    gained = 0.01 * np.cumsum(forces - np.array([0.0, 0.0, 9.81]), axis=0)
    differing = 0.5 * (gained[1:-1] + gained[2:])  # change of the mean velocities over steps
    differing -= differing[0]
    assert np.sqrt(np.mean((differing - (means[1:] - means[1])) ** 2)) < 0.05
    assert np.sqrt(np.mean((means[1:] - means[1]) ** 2)) > 0.3


def test_contacts_rewards_and_corrections_are_those_of_every_step(recording: Recording) -> None:
    steps, decoded, *_ = recording

    def values(topic: str) -> list[Any]:
        return [message.data for _, message in decoded[topic]]

    feet = np.column_stack([values(f"/contacts/{leg}") for leg in SIMPLE_QUAD.leg_names])
    assert feet.tolist() == [step.infos["foot_contact"][0].tolist() for step in steps]
    assert feet.any(axis=0).all()
    assert not feet.all()
    for part, name in (("trunk", "trunk_contact"), ("legs", "leg_contact")):
        assert values(f"/contacts/{part}") == [step.infos[name][0] for step in steps]
    terms = [name.removeprefix("reward_") for name in steps[0].infos if name.startswith("reward_")]
    assert terms
    summed = [sum(step.infos[f"reward_{term}"][0] for term in terms) for step in steps]
    np.testing.assert_allclose(values("/reward"), summed)
    shares = np.array([list(message.data) for _, message in decoded["/correction"]])
    assert shares.shape == (STEPS + 1, SIMPLE_QUAD.num_joints)
    assert 0.0 < np.abs(shares).max() <= 1.0


def test_topics_of_one_message_are_kept_for_nodes_that_start_later(recording: Recording) -> None:
    with recording.file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    offered = {each.topic: parse_qos(each.metadata["offered_qos_profiles"]) for each in summary.channels.values()}
    assert offered.keys() >= STANDARD_TOPICS.keys()
    latched = {topic for topic, qualities in offered.items() if qualities}
    assert latched == {"/robot_description", "/tf_static"}
    assert {each.durability for topic in latched for each in offered[topic]} == {QosDurability.TRANSIENT_LOCAL}


def test_topics_are_named_as_ros_allows() -> None:
    assert [topic_name("rewards", name) for name in ("two feet!", "3rd")] == ["/rewards/two_feet_", "/rewards/_3rd"]


def test_the_log_has_pushes_falls_and_commands_when_they_were(tmp_path: Path) -> None:
    steps: list[Step] = []
    walker, hard = policies.make("stand"), quad_env.scenario("push=150")
    with recorder_for(tmp_path / "walk.mcap", walker) as recorder:
        options = {"command": (0.5, 0.0, -0.25), "terminate_on_fall": False, "steps": 220}
        roll_out(walker, hard, np.array([3]), recorder, steps.append, **options)
    pushed = [step.number for step in steps if step.infos["push"].any()]
    down = [step.number for step in steps if step.infos["fall"][0]]
    lines = [(at, line) for at, line in events_of(read_mcap(tmp_path / "walk.mcap")) if not line.startswith("over")]
    assert lines[0] == (0, "command 0.50 m/s forward, 0.00 m/s left, -0.25 rad/s")
    assert lines[1] == (pushed[0], "pushed")
    assert [at for at, line in lines if line.startswith("fell: ")][:1] == down[:1] != []


def test_an_episode_after_a_reset_goes_on_in_time_and_a_slow_writer_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pipe holds fewer rows than are sent before the writer has started."""
    monkeypatch.setattr(recorder, "PIPE_SIZE", 4096)
    path, steps = tmp_path / "walk.mcap", []
    residual = policies.resolve("residual")
    with recorder_for(path, residual) as observer:
        roll_out(residual, "flat", np.array([3]), observer, steps.append, steps=30)
        roll_out(residual, "flat", np.array([4]), observer, steps.append, steps=20)
    decoded = read_mcap(path)
    assert [stamp for stamp, _ in decoded["/joint_states"]] == [10_000_000 * number for number in range(31 + 21)]
    positions = [list(state.position) for _, state in decoded["/joint_states"]]
    assert positions == [step.infos["joint_position"][0].tolist() for step in steps]
    assert [stamp // 10_000_000 for stamp, _ in decoded["/cmd_vel"]] == [*range(30), *range(31, 51)]
    lines = [(at, line) for at, line in events_of(decoded) if not line.startswith("command")]
    assert lines == [(31, "reset")]
    # The velocity is continuous from one episode to the next.
    assert decoded["/imu"][31][1].linear_acceleration.z == pytest.approx(9.81, abs=0.5)


def finished(path: Path) -> Decoded:
    """Return the content of a recording after the end of its writer, which may be the last process."""

    def whole() -> bool:
        return path.is_file() and path.stat().st_size > 8 and path.read_bytes().endswith(b"\x89MCAP0\r\n")

    until(whole, "it is not finished")
    return read_mcap(path)


def test_ctrl_c_keeps_what_was_recorded(tmp_path: Path, running: Any) -> None:
    path = tmp_path / "walk.mcap"
    command = [sys.executable, "-m", "quad_env", "record", str(path), "--policy", "trot", "--seconds", "3000"]
    with running(command) as recording:
        while not (path.exists() and path.stat().st_size > 50_000):
            assert recording.poll() is None
            time.sleep(0.05)
        recording.send_signal(signal.SIGINT)
        _, error = recording.communicate(timeout=60)
    assert recording.returncode == 130, error
    stamps = [stamp for stamp, _ in finished(path)["/joint_states"]]
    assert len(stamps) > 100
    assert stamps == [10_000_000 * number for number in range(len(stamps))]
    assert f"has the {(len(stamps) - 1) / 100:.1f} s until now" in error


ENDED = """
import os, signal, sys
from pathlib import Path
import numpy as np
import policies
from evaluate.rollouts.rollout import roll_out
from live.recording.recorder import recorder_for

def end(step):
    if step.number == int(sys.argv[2]):
        if sys.argv[3] == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        os.killpg(0, signal.SIGINT)  # as Ctrl-C does, in all processes of a terminal

if __name__ == "__main__":
    policy = policies.make("stand")
    with recorder_for(Path(sys.argv[1]), policy) as recorder:
        roll_out(policy, "flat", np.array([0]), recorder, end, steps=1000)
"""


@pytest.mark.parametrize(("step", "ending"), [(0, "Ctrl-C"), (250, "kill")])
def test_every_step_before_the_end_is_recorded(step: int, ending: str, tmp_path: Path) -> None:
    """The steps are recorded if the writer has not yet started or got no notification."""
    script, path = tmp_path / "ended.py", tmp_path / "walk.mcap"
    script.write_text(ENDED, encoding="utf-8")
    command = [sys.executable, str(script), str(path), str(step), ending]
    ended = subprocess.run(command, stderr=subprocess.PIPE, start_new_session=True, check=False)
    assert ended.returncode in (-signal.SIGKILL, -signal.SIGINT, 1), ended.stderr
    stamps = [stamp for stamp, _ in finished(path)["/joint_states"]]
    assert stamps == [10_000_000 * number for number in range(step + 1)]
