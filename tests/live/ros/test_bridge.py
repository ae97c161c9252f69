"""Robot side of the ROS interface, without ROS: after any message, the robot finally stands and reports the reason."""

from collections.abc import Iterator

import numpy as np
import pytest

import policies
from live.ros.bridge import HOME_TIME, JOIN_TIME, Bridge, JointTargetPolicy
from live.ros.node import IMU, JOINT_STATES, JOINT_TARGETS, RESET, VELOCITY
from live.session import Session
from policies.base import Policy
from quad_env.robots.simple_quad import SIMPLE_QUAD

HOME = SIMPLE_QUAD.home_pose
CROUCHED = HOME + np.tile([0.0, 0.2, -0.4], 4)


class Scene:
    """Robot with its ROS bridge, and the text on its terminal."""

    def __init__(self, policy: Policy, scenario: str = "flat") -> None:
        self.session = Session(policy, scenario)
        self.said: list[str] = []
        self.bridge = Bridge(self.session, self.said.append)

    def send(self, targets: np.ndarray) -> None:
        self.bridge.handle_message(JOINT_TARGETS, targets.tolist(), len(targets))

    def steer(self, forward: float, left: float, yaw_rate: float) -> None:
        self.bridge.handle_message(VELOCITY, [forward, left, yaw_rate], 3)

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.bridge.step()

    @property
    def targets(self) -> np.ndarray:
        return self.session.latest.action[0]

    @property
    def command(self) -> list[float]:
        self.step()
        return self.session.latest.infos["command"][0].tolist()


@pytest.fixture
def driven() -> Iterator[Scene]:
    scene = Scene(JointTargetPolicy())
    yield scene
    scene.session.close()


@pytest.fixture
def steered() -> Iterator[Scene]:
    scene = Scene(policies.make("trot"))
    yield scene
    scene.session.close()


def drive(scene: Scene, targets: np.ndarray, steps: int) -> None:
    for _ in range(steps):
        scene.send(targets)
        scene.step()


def test_without_a_message_the_robot_stands_and_nothing_is_complained_of(driven: Scene) -> None:
    driven.step(100)
    np.testing.assert_array_equal(driven.targets, np.float32(HOME))
    assert driven.said == []


def test_targets_are_joined_without_a_jump_and_then_followed_to_the_bit(driven: Scene) -> None:
    before = driven.targets
    for _ in range(round(JOIN_TIME / 0.01)):
        drive(driven, CROUCHED, 1)
        assert np.abs(driven.targets - before).max() < 0.03
        before = driven.targets
    drive(driven, CROUCHED, 1)
    np.testing.assert_array_equal(driven.targets, np.float32(CROUCHED))
    other = CROUCHED + 0.01
    drive(driven, other, 1)
    np.testing.assert_array_equal(driven.targets, np.float32(other))


def test_after_a_fifth_of_a_second_of_silence_the_robot_goes_home_until_messages_come_again(driven: Scene) -> None:
    drive(driven, CROUCHED, 40)
    for _ in range(2):  # a gap shorter than the timeout is no silence
        driven.step(20)
        drive(driven, CROUCHED, 1)
    driven.step(20)
    np.testing.assert_array_equal(driven.targets, np.float32(CROUCHED))
    assert not any("nothing good" in line for line in driven.said)
    driven.step()
    assert driven.said[-1].startswith(f"nothing good on {JOINT_TARGETS} for 0.2 s: the robot returns to its standing")
    assert (driven.targets != np.float32(CROUCHED)).any()
    driven.step(round(HOME_TIME / 0.01))
    np.testing.assert_allclose(driven.targets, HOME, atol=1e-6)
    driven.step(40)
    np.testing.assert_allclose(driven.session.latest.infos["joint_position"][0], HOME, atol=0.05)
    assert sum("nothing good" in line for line in driven.said) == 1
    drive(driven, CROUCHED, 40)
    np.testing.assert_array_equal(driven.targets, np.float32(CROUCHED))
    assert [line for line in driven.said if line.endswith("is followed")] == 2 * [f"{JOINT_TARGETS} is followed"]


def test_bad_messages_are_refused_and_count_as_silence(driven: Scene) -> None:
    drive(driven, CROUCHED, 40)
    for bad in (np.zeros(11), np.zeros(13), np.append(HOME[:11], np.nan), np.append(HOME[:11], np.inf)):
        driven.send(bad)
        driven.step()
        np.testing.assert_array_equal(driven.targets, np.float32(CROUCHED))
    assert sum("refused, not 12 numbers" in line for line in driven.said) == 1
    assert sum("refused, not finite" in line for line in driven.said) == 1
    drive(driven, np.full(12, np.nan), 66)
    assert sum("nothing good" in line for line in driven.said) == 1
    np.testing.assert_allclose(driven.targets, HOME, atol=1e-6)


def test_targets_past_the_joints_stops_stop_there(driven: Scene) -> None:
    drive(driven, np.full(12, 1e9), 40)
    np.testing.assert_array_equal(driven.targets, np.float32(SIMPLE_QUAD.joint_upper))
    driven.step(22)  # the way home starts at the joint limits
    assert np.abs(driven.targets - SIMPLE_QUAD.joint_upper).max() < 0.2
    assert (driven.targets[2::3] < -0.02).all()


def test_velocities_move_a_robot_that_has_a_policy(steered: Scene) -> None:
    assert steered.command == [0.0, 0.0, 0.0]
    for _ in range(150):
        steered.steer(0.4, 0.0, 0.0)
        steered.step()
    assert steered.session.latest.infos["position"][0, 0] > 0.25
    steered.step(51)
    assert steered.said[-1] == f"nothing good on {VELOCITY} for 0.5 s: the command is zero until the next"
    assert steered.command == [0.0, 0.0, 0.0]
    steered.steer(0.0, 0.1, -0.2)
    assert steered.command == [0.0, 0.1, -0.2]


def test_a_velocity_that_is_none_is_refused(steered: Scene) -> None:
    steered.steer(0.4, 0.0, 0.0)
    for bad in ((np.nan, 0.0, 0.0), (0.0, -np.inf, 0.0), (0.0, 0.0, 1e6)):
        steered.steer(*bad)
    assert steered.command == [0.4, 0.0, 0.0]
    reasons = "refused, not finite", "refused, beyond ±100 m/s or rad/s"
    assert [sum(reason in line for line in steered.said) for reason in reasons] == [1, 1]


def test_one_topic_moves_a_robot_and_the_other_is_refused(driven: Scene, steered: Scene) -> None:
    steered.send(CROUCHED)
    driven.steer(0.4, 0.0, 0.0)
    assert steered.said == [
        f"{JOINT_TARGETS}: refused, {VELOCITY} moves this robot; further ones are refused without a word"
    ]
    assert driven.said == [
        f"{VELOCITY}: refused, {JOINT_TARGETS} moves this robot; further ones are refused without a word"
    ]
    assert driven.command == [0.0, 0.0, 0.0]


def test_a_fallen_robot_says_so_once_and_a_reset_stands_it_up_with_time_running_on(driven: Scene) -> None:
    lying = np.tile([0.0, 1.5, -0.5], 4)
    drive(driven, lying, 120)
    told = [line for line in driven.said if "fallen" in line]
    assert len(told) == 1
    assert RESET in told[0]
    before = driven.bridge.time
    driven.bridge.handle_message(RESET, [], 0)
    driven.step()
    assert driven.bridge.time == pytest.approx(before + 0.01)
    assert driven.session.latest.infos["height"][0] > 0.4
    np.testing.assert_array_equal(driven.targets, np.float32(HOME))


def test_readings_come_at_their_rates_with_stamps_of_simulated_time(driven: Scene) -> None:
    packets = [driven.bridge.step() for _ in range(40)]
    assert [packet["time"] for packet in packets] == [10_000_000 * (1 + number) for number in range(40)]
    assert [packet["time"] for packet in packets if JOINT_STATES in packet] == [20_000_000 * (1 + n) for n in range(20)]
    told, state = driven.session.latest.infos, packets[-1][JOINT_STATES]
    assert state["position"] == told["joint_position"][0].tolist()
    assert state["velocity"] == told["joint_velocity"][0].tolist()
    assert state["torque"] == told["joint_torque"][0].tolist()
    np.testing.assert_allclose(packets[-1][IMU]["specific_force"], [0.0, 0.0, 9.81], atol=1.5)


def test_a_reset_is_no_jolt_to_the_imu(steered: Scene) -> None:
    for _ in range(100):
        steered.steer(1.0, 0.0, 0.0)
        steered.step()
    steered.bridge.handle_message(RESET, [], 0)
    packet = steered.bridge.step()
    assert np.linalg.norm(packet[IMU]["specific_force"]) < 15.0
