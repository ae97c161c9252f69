"""Recordings, read back by a decoder that is not the library which wrote them, are what the simulation did."""

import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

import policies
import quad_env
from evaluate.measures.metrics import outcome
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out, run
from live.recording.messages import STANDARD, topic_name
from live.recording.recorder import recorder_for
from live.recording.rows import LENGTH
from quad_env.__main__ import main
from quad_env.physics.state import rotation_matrix
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.waiting import until

STEPS = 130
LATCH = QosDurability.TRANSIENT_LOCAL
Decoded = dict[str, list[tuple[int, Any]]]


def walked(path: Path, policy: str = "residual", scenario: str = "push=42", **options: Any) -> list[Step]:
    """Record an episode; its control steps as they were."""
    steps: list[Step] = []
    walker = policies.make(policy)
    with recorder_for(path, walker) as recorder:
        roll_out(
            walker, quad_env.scenario(scenario), np.array([3]), recorder, steps.append, **({"steps": STEPS} | options)
        )
    return steps


def read_mcap(path: Path) -> Decoded:
    """Every message of a file, by topic."""
    told: Decoded = {}
    with path.open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        for _schema, channel, message, content in messages:
            told.setdefault(channel.topic, []).append((message.log_time, content))
    return told


def read_rosbags(path: Path) -> Decoded:
    """The same of a file or a bag by another library, which knows the standard types alone."""
    told: Decoded = {}
    types = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(path) as reader:
        for connection, time_ns, data in reader.messages():
            told.setdefault(connection.topic, []).append((time_ns, types.deserialize_cdr(data, connection.msgtype)))
    return told


@pytest.fixture(scope="module", params=["walk.mcap", "walk"])
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Step], Decoded]:
    path = tmp_path_factory.mktemp("recording") / request.param
    steps = walked(path)
    return steps, read_mcap(path if path.suffix else next(path.glob("*.mcap")))


def test_joint_states_are_those_of_every_step_at_its_end(recording: tuple[list[Step], Decoded]) -> None:
    steps, told = recording
    assert [stamp for stamp, _ in told["/joint_states"]] == [10_000_000 * number for number in range(STEPS + 1)]
    for step, (stamp, state) in zip(steps, told["/joint_states"], strict=True):
        assert state.name == list(SIMPLE_QUAD.joint_names)
        assert list(state.position) == step.infos["joint_position"][0].tolist()
        assert list(state.velocity) == step.infos["joint_velocity"][0].tolist()
        assert list(state.effort) == step.infos["joint_torque"][0].tolist()
        assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == stamp
    assert [clock.clock.nanosec for _, clock in told["/clock"]][:3] == [0, 10_000_000, 20_000_000]


def test_targets_and_commands_are_stamped_when_they_were_given(recording: tuple[list[Step], Decoded]) -> None:
    steps, told = recording
    assert [stamp for stamp, _ in told["/position_controller/command"]] == [10_000_000 * n for n in range(STEPS)]
    for step, (_, targets), (_, twist) in zip(
        steps[1:], told["/position_controller/command"], told["/cmd_vel"], strict=True
    ):
        assert list(targets.data) == step.infos["action"][0].tolist()
        asked = twist.linear.x, twist.linear.y, twist.angular.z
        assert asked == tuple(step.infos["command"][0])


def test_the_trunk_turns_as_ros_writes_it_and_the_chain_of_links_ends_where_the_feet_are(
    recording: tuple[list[Step], Decoded],
) -> None:
    steps, told = recording
    [(at, fixed)] = told["/tf_static"]
    assert at == 0
    for step, (_, frames) in list(zip(steps, told["/tf"], strict=True))[::10]:
        trunk, *links = frames.transforms
        turn = trunk.transform.rotation
        assert (turn.w, turn.x, turn.y, turn.z) == tuple(step.infos["quaternion"][0])
        assert (trunk.header.frame_id, trunk.child_frame_id) == ("world", "base_link")
        tree = {frame.child_frame_id: frame for frame in (trunk, *links, *fixed.transforms)}
        feet = [in_world(tree, f"{leg}_foot_link")[1] for leg in SIMPLE_QUAD.leg_names]
        np.testing.assert_allclose(feet, step.infos["foot_position"][0], atol=1e-12)
    urdf = ElementTree.fromstring(told["/robot_description"][0][1].data)
    assert {link.get("name") for link in urdf.iter("link")} == set(tree)


def in_world(tree: dict[str, Any], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Rotation matrix and place of a frame, m."""
    if name == "world":
        return np.eye(3), np.zeros(3)
    frame = tree[name]
    turned, at = in_world(tree, frame.header.frame_id)
    moved, turn = frame.transform.translation, frame.transform.rotation
    own = np.array(rotation_matrix((turn.w, turn.x, turn.y, turn.z)))
    return turned @ own, at + turned @ [moved.x, moved.y, moved.z]


def test_the_imu_feels_its_own_weight_and_every_change_of_its_velocity(recording: tuple[list[Step], Decoded]) -> None:
    steps, told = recording
    felt = np.array([[getattr(imu.linear_acceleration, axis) for axis in "xyz"] for _, imu in told["/imu"]])
    turns = np.array([[getattr(imu.angular_velocity, axis) for axis in "xyz"] for _, imu in told["/imu"]])
    assert turns.tolist() == [step.infos["angular_velocity"][0].tolist() for step in steps]
    # Positions are told by the simulation, not by what the IMU was made of.
    places = np.array([step.infos["position"][0] for step in steps])
    means = (places[1:] - places[:-1]) / 0.01  # velocities over the steps
    turned = [np.array(rotation_matrix(step.infos["quaternion"][0])) for step in steps]
    forces = np.array([rotation @ force for rotation, force in zip(turned, felt, strict=True)])
    gained = 0.01 * np.cumsum(forces - np.array([0.0, 0.0, 9.81]), axis=0)  # of the velocities at the steps' ends
    differing = 0.5 * (gained[1:-1] + gained[2:])  # of means over steps
    differing -= differing[0]
    assert np.sqrt(np.mean((differing - (means[1:] - means[1])) ** 2)) < 0.05
    assert np.sqrt(np.mean((means[1:] - means[1]) ** 2)) > 0.3


def test_a_robot_that_stands_on_a_slope_feels_where_down_is(tmp_path: Path) -> None:
    steps = walked(tmp_path / "still.mcap", "stand", "slope=10", command=(0.0, 0.0, 0.0))
    (_, imu) = read_mcap(tmp_path / "still.mcap")["/imu"][-1]
    felt = np.array([imu.linear_acceleration.x, imu.linear_acceleration.y, imu.linear_acceleration.z])
    down = steps[-1].observation[0, :3]
    assert np.abs(down[:2]).max() > 0.05
    np.testing.assert_allclose(felt, -9.81 * down, atol=0.3)


def values(told: Decoded, topic: str) -> list[Any]:
    return [message.data for _, message in told[topic]]


def test_contacts_rewards_and_corrections_are_those_of_every_step(recording: tuple[list[Step], Decoded]) -> None:
    steps, told = recording
    feet = np.column_stack([values(told, f"/contacts/{leg}") for leg in SIMPLE_QUAD.leg_names])
    assert feet.tolist() == [step.infos["foot_contact"][0].tolist() for step in steps]
    assert feet.any(axis=0).all()
    assert not feet.all()
    for part, name in (("trunk", "trunk_contact"), ("legs", "leg_contact")):
        assert values(told, f"/contacts/{part}") == [step.infos[name][0] for step in steps]
    terms = [name.removeprefix("reward_") for name in steps[0].infos if name.startswith("reward_")]
    for term in terms:
        assert values(told, f"/rewards/{term}") == [step.infos[f"reward_{term}"][0] for step in steps]
    summed = np.sum([values(told, f"/rewards/{term}") for term in terms], axis=0)
    np.testing.assert_allclose(values(told, "/rewards/total"), summed)
    assert [stamp for stamp, _ in told["/rewards/total"]] == [stamp for stamp, _ in told["/joint_states"]]
    shares = np.array([list(message.data) for _, message in told["/correction"]])
    assert shares.shape[1] == SIMPLE_QUAD.num_joints
    assert np.abs(shares).max() <= 1.0
    assert np.abs(shares).max() > 0.0


def events_of(told: Decoded) -> list[tuple[int, str]]:
    """Control step, or start of an episode, at whose end each event was, and its line."""
    return [(stamp // 10_000_000, line.msg) for stamp, line in told.get("/events", [])]


@pytest.mark.parametrize("impulse", [5, 150])
def test_the_log_has_pushes_falls_and_commands_when_they_were(impulse: int, tmp_path: Path) -> None:
    steps = walked(
        tmp_path / "walk.mcap",
        "stand",
        f"push={impulse}",
        command=(0.5, 0.0, -0.25),
        terminate_on_fall=False,
        steps=220,
    )
    pushed = [step.number for step in steps if step.infos["push"].any()]
    down = [step.number for step in steps if step.infos["fall"][0]]
    lines = [(at, line) for at, line in events_of(read_mcap(tmp_path / "walk.mcap")) if not line.startswith("over")]
    assert lines[0] == (0, "command 0.50 m/s forward, 0.00 m/s left, -0.25 rad/s")
    assert lines[1] == (pushed[0], "pushed")
    assert [at for at, line in lines if line.startswith("fell: ")][:1] == down[:1]
    assert bool(down) == (impulse > 100)
    assert lines[-1] == (220, "outcome: fell" if down else "outcome: stalled")


def test_the_outcome_is_that_of_an_evaluation(tmp_path: Path) -> None:
    path, walker, steps, seeds = tmp_path / "walk.mcap", policies.make("trot"), 700, np.array([3])
    with recorder_for(path, walker) as recorder:
        roll_out(walker, "flat", seeds, recorder, steps=steps, terminate_on_fall=False)
    [judged] = outcome(run(walker, "flat", seeds, steps=steps))
    assert events_of(read_mcap(path))[-1] == (steps, f"outcome: {judged.replace('_', ' ')}")


def test_an_episode_after_a_reset_goes_on_in_time_and_tells_its_start_and_what_the_live_view_says(
    tmp_path: Path,
) -> None:
    path, steps = tmp_path / "walk.mcap", []
    trot, residual = policies.make("trot"), policies.resolve("residual")
    with recorder_for(path, trot) as recorder:
        recorder.event("before the start")
        roll_out(trot, "flat", np.array([3]), recorder, steps.append, steps=30)
        recorder.event("residual chosen")
        recorder.policy = residual
        roll_out(residual, "flat", np.array([4]), recorder, steps.append, steps=20)
    told = read_mcap(path)
    assert [stamp for stamp, _ in told["/joint_states"]] == [10_000_000 * number for number in range(31 + 21)]
    positions = [list(state.position) for _, state in told["/joint_states"]]
    assert positions == [step.infos["joint_position"][0].tolist() for step in steps]
    assert [stamp // 10_000_000 for stamp, _ in told["/cmd_vel"]] == [*range(30), *range(31, 51)]
    assert [stamp // 10_000_000 for stamp, _ in told["/correction"]] == [*range(31, 52)]
    lines = [(at, line) for at, line in events_of(told) if not line.startswith("command")]
    assert lines == [(0, "before the start"), (30, "residual chosen"), (31, "reset")]
    assert told["/imu"][31][1].linear_acceleration.z == pytest.approx(9.81, abs=0.5)  # no jump from one to the other


@pytest.mark.parametrize("name", ["walk.mcap", "walk"])
def test_two_libraries_read_the_whole_of_a_recording_alike(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    walked(path)
    first, second = read_mcap(path if path.suffix else next(path.glob("*.mcap"))), read_rosbags(path)
    assert first.keys() == second.keys() >= STANDARD.keys()
    for topic, messages in first.items():
        assert [stamp for stamp, _ in messages] == [stamp for stamp, _ in second[topic]]
    for topic in ("/contacts/fl", "/rewards/total", "/rewards/torque"):
        assert values(first, topic) == values(second, topic)
    for (_, one), (_, other) in zip(first["/correction"], second["/correction"], strict=True):
        assert list(one.data) == other.data.tolist()


def test_a_recording_has_one_encoding(tmp_path: Path) -> None:
    walked(tmp_path / "walk.mcap", steps=3)
    with (tmp_path / "walk.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}


def test_topics_are_named_as_ros_allows() -> None:
    assert [topic_name("rewards", name) for name in ("two feet!", "3rd")] == ["/rewards/two_feet_", "/rewards/_3rd"]


def test_a_bag_keeps_topics_of_one_message_for_nodes_that_start_later(tmp_path: Path) -> None:
    walked(tmp_path / "bag", steps=20)
    with Reader(tmp_path / "bag") as bag:
        types = {connection.topic: connection.msgtype for connection in bag.connections}
        count = {connection.topic: connection.msgcount for connection in bag.connections}
        kept = {c.topic for c in bag.connections if [q.durability for q in c.ext.offered_qos_profiles] == [LATCH]}
    assert types.items() >= STANDARD.items()
    assert kept == {"/robot_description", "/tf_static"}
    assert count["/joint_states"] == 20 + 1
    assert count["/cmd_vel"] == 20


def test_what_exists_is_left_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = tmp_path / "walk.mcap"
    kept.write_text("mine", encoding="utf-8")
    assert main(["record", str(kept)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert kept.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--policy", "trott"], "trott"),
        (["--scenario", "moon"], "--scenario"),
        (["--scenario", "push:all"], "name one of them"),
        (["--seconds", "0"], "--seconds must be"),
        (["--seconds", "nan"], "--seconds must be"),
        (["--command", "nan", "0", "0"], "--command must be"),
        (["--robot", "nobody"], "--robot"),
    ],
)
def test_a_mistake_is_a_line_and_nothing_is_written(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["record", str(tmp_path / "walk.mcap"), *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error
    assert not list(tmp_path.iterdir())


def finished(path: Path) -> Decoded:
    """What a recording has once the process that writes it is through, which may outlive all others."""

    def whole() -> bool:
        return path.is_file() and path.stat().st_size > 8 and path.read_bytes().endswith(b"\x89MCAP0\r\n")

    until(whole, "it is not finished")
    return read_mcap(path)


def test_ctrl_c_keeps_what_was_recorded(tmp_path: Path, running: Any) -> None:
    path = tmp_path / "walk.mcap"
    command = [sys.executable, "-m", "quad_env", "record", str(path), "--policy", "trot", "--seconds", "3000"]
    with running(command) as recording:
        while not (path.exists() and path.stat().st_size > 400_000):
            assert recording.poll() is None
            time.sleep(0.05)
        recording.send_signal(signal.SIGINT)
        _, error = recording.communicate(timeout=60)
    assert recording.returncode == 130, error
    stamps = [stamp for stamp, _ in finished(path)["/joint_states"]]
    assert len(stamps) > 200
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
    policy = policies.make("trot")
    with recorder_for(Path(sys.argv[1]), policy) as recorder:
        roll_out(policy, "flat", np.array([0]), recorder, end, steps=1000)
"""


@pytest.mark.parametrize(("step", "ending"), [(0, "kill"), (199, "kill"), (250, "kill"), (0, "Ctrl-C")])
def test_every_step_before_the_end_is_recorded(step: int, ending: str, tmp_path: Path) -> None:
    """Whether or not the writer had been told of them, and had started."""
    script, path = tmp_path / "ended.py", tmp_path / "walk.mcap"
    script.write_text(ENDED, encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, str(script), str(path), str(step), ending],
        stderr=subprocess.PIPE,
        start_new_session=True,
        check=False,
    )
    assert ended.returncode in (-signal.SIGKILL, -signal.SIGINT, 1), ended.stderr
    stamps = [stamp for stamp, _ in finished(path)["/joint_states"]]
    assert stamps == [10_000_000 * number for number in range(step + 1)]


def test_a_simulation_that_is_faster_than_the_file_waits_and_loses_nothing(tmp_path: Path) -> None:
    path, policy = tmp_path / "walk.mcap", policies.make("stand")
    with recorder_for(path, policy) as recorder:

        def often(step: Step) -> None:
            for _ in range(20):
                recorder(replace(step, number=1))

        roll_out(policy, "flat", np.array([3]), recorder, often, steps=400)
    with path.open("rb") as file:
        told = make_reader(file).get_summary()
    counts = {channel.topic: told.statistics.channel_message_counts.get(n) for n, channel in told.channels.items()}
    assert counts["/clock"] == 21 * 401 > LENGTH
