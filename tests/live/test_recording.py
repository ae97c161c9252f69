"""Recordings, read back by a decoder that is not the library which wrote them, are what the simulation did."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader

import policies
import quad_env
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from live.__main__ import PROGRAM
from live.recording.messages import STANDARD
from live.recording.recorder import recorder_for
from quad_env.__main__ import main
from quad_env.physics.state import rotation_matrix
from quad_env.robots.simple_quad import SIMPLE_QUAD

STEPS = 130
Decoded = dict[str, list[tuple[int, Any]]]


def walked(path: Path, policy: str = "residual", scenario: str = "push=42", **options: Any) -> list[Step]:
    """Record an episode; its control steps as they were."""
    steps: list[Step] = []
    walker = policies.make(policy)
    with recorder_for(path, walker) as recorder:
        roll_out(walker, quad_env.scenario(scenario), np.array([3]), recorder, steps.append, steps=STEPS, **options)
    return steps


def read_mcap(path: Path) -> Decoded:
    with path.open("rb") as file:
        reader, decoders = make_reader(file), DecoderFactory()
        told: Decoded = {}
        for schema, channel, message in reader.iter_messages():
            content = json.loads(message.data) if channel.message_encoding == "json" else None
            if content is None:
                content = decoders.decoder_for("cdr", schema)(message.data)
            told.setdefault(channel.topic, []).append((message.log_time, content))
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


def test_the_trunk_turns_as_ros_writes_it_and_the_feet_are_where_they_are(
    recording: tuple[list[Step], Decoded],
) -> None:
    steps, told = recording
    for step, (_, frames) in zip(steps, told["/tf"], strict=True):
        trunk, *feet = frames.transforms
        w, x, y, z = step.infos["quaternion"][0]
        turn = trunk.transform.rotation
        assert (turn.x, turn.y, turn.z, turn.w) == (x, y, z, w)
        assert (trunk.header.frame_id, trunk.child_frame_id) == ("world", "base_link")
        assert [frame.child_frame_id for frame in feet] == [f"{leg}_foot" for leg in SIMPLE_QUAD.leg_names]
        places = [[getattr(frame.transform.translation, axis) for axis in "xyz"] for frame in feet]
        assert places == step.infos["foot_position"][0].tolist()


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


def test_an_mcap_file_tells_contacts_rewards_correction_and_events_by_name(tmp_path: Path) -> None:
    steps = walked(tmp_path / "walk.mcap")
    told = read_mcap(tmp_path / "walk.mcap")
    for step, (_, contacts), (_, rewards) in zip(steps, told["/contacts"], told["/rewards"], strict=True):
        assert list(contacts["feet"].values()) == step.infos["foot_contact"][0].tolist()
        assert rewards["total"] == pytest.approx(sum(v for name, v in rewards.items() if name != "total"))
        assert rewards["linear_velocity_tracking"] == step.infos["reward_linear_velocity_tracking"][0]
        assert rewards["torque"] == step.infos["reward_torque"][0]
    shares = np.array([list(correction.values()) for _, correction in told["/correction"]])
    assert list(told["/correction"][0][1]) == list(SIMPLE_QUAD.joint_names)
    assert np.abs(shares).max() <= 1.0
    assert np.abs(shares).max() > 0.0
    pushed = [step.number for step in steps if step.infos["push"].any()]
    events = [(stamp // 10_000_000, event["event"]) for stamp, event in told.get("/events", [])]
    assert events[:1] == ([(pushed[0], "pushed")] if pushed else [])


def test_rosbags_and_mcap_read_the_same_bag(tmp_path: Path) -> None:
    walked(tmp_path / "bag")
    with Reader(tmp_path / "bag") as bag:
        assert {connection.topic: connection.msgtype for connection in bag.connections} == STANDARD
        count = {connection.topic: connection.msgcount for connection in bag.connections}
    assert count["/joint_states"] == STEPS + 1
    assert count["/cmd_vel"] == STEPS


def test_what_exists_is_left_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = tmp_path / "walk.mcap"
    kept.write_text("mine")
    assert main(["record", str(kept)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert kept.read_text() == "mine"


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
    assert PROGRAM.main(["record", str(tmp_path / "walk.mcap"), *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL])
def test_what_was_recorded_outlives_whoever_recorded_it(ending: signal.Signals, tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    command = [sys.executable, "-m", "quad_env", "record", str(path), "--policy", "trot", "--seconds", "3000"]
    recording = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # deaf where the tests are a background job
    )
    for _ in range(400):
        time.sleep(0.05)
        if path.exists() and path.stat().st_size > 400_000:
            break
    recording.send_signal(ending)
    _, error = recording.communicate(timeout=30)
    assert recording.returncode == (130 if ending == signal.SIGINT else -signal.SIGKILL), error
    for _ in range(400):  # the process that writes goes on to the end of what it was given
        if path.read_bytes().endswith(b"\x89MCAP0\r\n") and path.stat().st_size > 8:
            break
        time.sleep(0.05)
    told = read_mcap(path)
    stamps = [stamp for stamp, _ in told["/joint_states"]]
    assert len(stamps) > 200
    assert stamps == [10_000_000 * number for number in range(len(stamps))]
