"""Requests to the robots of a running view take effect, and invalid requests change nothing."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from live.view.controller import MAX_EVENTS, ViewController
from live.view.requests import REQUESTS, Request
from live.view.telemetry import MAX_ROWS
from policies.base import PolicyError
from quad_env.task.rewards import REWARD

FAILING = """
class Failing:
    steps = 0
    def __call__(self, observation):
        self.steps += 1
        return [0.0, 0.5, -1.0] * 4 if self.steps < 15 else 1 / 0
"""

RIGHTLY: dict[str, dict[str, Any]] = {
    "steer": {"forward": 0.5, "left": 0.0, "turn": 0.0},
    "push": {"direction": 90.0, "impulse": 5.0},
    "policy": {"robot": 0, "name": "trot"},
    "scenario": {"name": "slope=10"},
    "reset": {"seed": 5},
    "speed": {"factor": 10.0},
    "drag": {"right": 3.0, "down": 4.0},
    "zoom": {"wheel": 3.0},
}
"""Arguments of requests; the others have none, or `on`."""


@pytest.fixture
def driver() -> Iterator[ViewController]:
    with closing(ViewController(["trot"], command=(0.0, 0.0, 0.0))) as found:
        found.handle(Request("speed", {"factor": 10.0}))
        yield found


def walk(driver: ViewController, steps: int) -> dict[str, Any]:
    for _ in range(steps):
        assert driver.step()
    return driver.state()


def test_every_request_is_done(driver: ViewController) -> None:
    for name, wanted in REQUESTS.items():
        values = RIGHTLY.get(name) or ({"on": True} if "on" in wanted else {})
        driver.handle(Request(name, values))
        assert set(values) == set(wanted)
    driver.handle(Request("pause", {"on": False}))
    assert walk(driver, 3)["scenario"] == "slope=10"


def test_it_walks_and_turns_where_it_is_steered_and_the_page_is_sent_that(driver: ViewController) -> None:
    before = driver.state()["robots"][0]["heading"]
    driver.handle(Request("steer", {"forward": 0.5, "left": 0.0, "turn": 0.8}))
    state = walk(driver, 150)
    assert state["command"] == [0.5, 0.0, 0.8]
    assert state["robots"][0]["velocity"][0] == pytest.approx(0.5, abs=0.25)
    assert 20.0 < (state["robots"][0]["heading"] - before) % 360.0 < 90.0
    (robot,) = state["robots"]
    assert len(robot["rows"]) == 150
    time, command, velocity, contacts, torque, reward = robot["rows"][-1]
    infos = driver.sessions[0].latest.infos
    assert time == 1.5
    assert command == [0.5, 0.0, 0.8]
    assert velocity == pytest.approx(infos["heading_velocity"][0], abs=1e-3)
    assert contacts == infos["foot_contact"][0].astype(int).tolist()
    assert torque == pytest.approx(np.abs(infos["joint_torque"][0]).max() / 100.0, abs=1e-3)
    rewards = [float(values[0]) for name, values in infos.items() if name.startswith(REWARD)]
    assert reward == pytest.approx(sum(rewards), abs=1e-4)
    assert robot["correction"] is None
    assert driver.state()["robots"][0]["rows"] == []
    # Pushes are relative to the robot's heading, which differs from the world's x axis.
    for direction, axis, sign in ((0.0, 0, 1), (90.0, 1, 1), (-90.0, 1, -1)):
        driver.handle(Request("push", {"direction": direction, "impulse": 12.0}))
        state = walk(driver, 10)
        heading = np.radians(state["robots"][0]["heading"])
        x, y = driver.sessions[0].latest.infos["push"][0]
        own = (np.cos(heading) * x + np.sin(heading) * y, -np.sin(heading) * x + np.cos(heading) * y)
        assert own[axis] == pytest.approx(sign * 120.0, rel=0.05)  # 12 N·s in 0.1 s
        assert "pushed by hand, 12 N·s" in state["events"]
        walk(driver, 1)
        assert not driver.sessions[0].latest.infos["push"].any()


def test_again_is_the_same_episode_to_the_bit_whatever_began_it_and_for_a_second_robot_too(
    driver: ViewController,
) -> None:
    def positions() -> list[list[float]]:
        walk(driver, 30)
        return [session.latest.infos["position"][0].tolist() for session in driver.sessions]

    driver.handle(Request("steer", {"forward": 0.5, "left": 0.0, "turn": 0.0}))
    for begin in (Request("scenario", {"name": "push"}), Request("policy", {"robot": 1, "name": "trot"})):
        driver.handle(begin)
        found = positions()
        driver.handle(Request("reset", {"seed": driver.sessions[0].seed}))
        assert positions() == found
    assert found[0] == found[1]
    # The episode restarts, although the new policy has a height scan.
    driver.handle(Request("policy", {"robot": 1, "name": "mpc_wbc_sighted"}))
    assert driver.state()["time"] == 0.0
    assert positions()[0] == found[0] != positions()[1]
    first, second = (session.env.pushes.force[0].tolist() for session in driver.sessions)
    assert first == second
    with closing(ViewController(["trot"], "push", command=(0.5, 0.0, 0.0))) as fresh:
        walk(fresh, 30)
        assert fresh.sessions[0].latest.infos["position"][0].tolist() == found[0]


def test_rows_are_of_the_present_episode_name_the_feet_in_their_order_and_are_no_more_than_a_page_shows(
    driver: ViewController,
) -> None:
    walk(driver, 5)
    driver.handle(Request("next", {}))
    assert len(walk(driver, 2)["robots"][0]["rows"]) == 2
    session, telemetry = driver.sessions[0], driver._telemetry[0]
    lifted = {**session.latest.infos, "foot_contact": np.array([[True, False, False, False]])}
    for _ in range(MAX_ROWS + 20):
        telemetry(replace(session.latest, infos=lifted))
    rows = telemetry.state()["rows"]
    assert rows[0][3] == [1, 0, 0, 0]
    assert len(rows) == MAX_ROWS
    for _ in range(MAX_EVENTS + 5):
        driver.handle(Request("push", {"direction": 0.0, "impulse": 0.0}))
    assert len(driver.state()["events"]) == MAX_EVENTS


def test_paused_it_stands_still_but_for_single_steps(driver: ViewController) -> None:
    walk(driver, 5)
    driver.handle(Request("pause", {"on": True}))
    assert not driver.step()
    driver.handle(Request("step", {}))
    assert driver.step()
    assert not driver.step()
    assert driver.state()["time"] == 0.06


def test_scenarios_and_robots_change_with_the_command_kept_until_it_is_given_back(driver: ViewController) -> None:
    driver.handle(Request("steer", {"forward": 0.4, "left": 0.1, "turn": 0.0}))
    driver.handle(Request("policy", {"robot": 0, "name": "stand"}))
    driver.handle(Request("scenario", {"name": "slope=10"}))
    driver.handle(Request("policy", {"robot": 1, "name": "trot"}))
    state = walk(driver, 2)
    assert [robot["policy"] for robot in state["robots"]] == ["stand", "trot"]
    assert (state["scenario"], state["command"]) == ("slope=10", [0.4, 0.1, 0.0])
    driver.handle(Request("alone", {}))
    driver.handle(Request("let_go", {}))
    state = walk(driver, 1)
    assert len(state["robots"]) == 1
    assert not state["by_hand"]
    assert state["command"] != [0.4, 0.1, 0.0]


def test_a_push_is_given_to_every_robot_and_told_once(driver: ViewController) -> None:
    """The direction is relative to the first robot: each robot has the same force, world frame."""
    driver.handle(Request("policy", {"robot": 1, "name": "stand"}))
    walk(driver, 2)
    driver.handle(Request("push", {"direction": 0.0, "impulse": 6.0}))
    state = walk(driver, 1)
    first, second = (session.latest.infos["push"][0] for session in driver.sessions)
    assert np.hypot(*first) == pytest.approx(60.0, rel=1e-3)
    np.testing.assert_array_equal(first, second)
    assert state["events"].count("pushed by hand, 6 N·s") == 1
    assert driver.state()["events"] == []


def test_another_policy_for_one_robot_leaves_the_others_theirs(driver: ViewController) -> None:
    for robot, name in ((1, "stand"), (2, "document"), (0, "trot_integral")):
        driver.handle(Request("policy", {"robot": robot, "name": name}))
    assert [robot["policy"] for robot in driver.state()["robots"]] == ["trot_integral", "stand", "document"]
    driver.handle(Request("policy", {"robot": 1, "name": "trot"}))
    assert [robot["policy"] for robot in driver.state()["robots"]] == ["trot_integral", "trot", "document"]


def test_a_single_step_pauses_robots_that_were_walking(driver: ViewController) -> None:
    walk(driver, 2)
    driver.handle(Request("step", {}))
    assert driver.state()["paused"]
    assert driver.step()
    assert not driver.step()
    driver.handle(Request("pause", {"on": False}))
    assert driver.step()


def test_letting_go_gives_every_robot_its_episode_again_with_the_commands_of_its_seed(driver: ViewController) -> None:
    driver.handle(Request("policy", {"robot": 1, "name": "stand"}))
    driver.handle(Request("reset", {"seed": 7}))
    driver.handle(Request("steer", {"forward": 0.4, "left": 0.1, "turn": 0.0}))
    walk(driver, 3)
    driver.handle(Request("let_go", {}))
    assert [session.seed for session in driver.sessions] == [7, 7]
    state = walk(driver, 2)
    assert (state["seed"], state["time"], state["by_hand"]) == (7, 0.02, False)
    with closing(ViewController(["trot"], seed=7)) as drawn:
        assert walk(drawn, 2)["command"] == state["command"]


def test_next_is_the_episode_of_the_next_seed_and_a_change_of_robots_keeps_it(driver: ViewController) -> None:
    driver.handle(Request("next", {}))
    assert [session.seed for session in driver.sessions] == [1]
    for change in (Request("policy", {"robot": 1, "name": "stand"}), Request("scenario", {"name": "slope=10"})):
        driver.handle(change)
        assert [session.seed for session in driver.sessions] == [1, 1]
    driver.handle(Request("next", {}))
    assert [session.seed for session in driver.sessions] == [2, 2]
    driver.handle(Request("alone", {}))
    assert [session.seed for session in driver.sessions] == [2]


@pytest.mark.parametrize(
    ("what", "values", "error"),
    [
        ("policy", {"robot": 2, "name": "trot"}, ValueError),
        ("policy", {"robot": 0, "name": "/etc"}, PolicyError),
        ("policy", {"robot": 0, "name": "FILE.py:Planted"}, PolicyError),
        ("scenario", {"name": "FILE.py:planted"}, ValueError),
        ("scenario", {"name": "push:all"}, ValueError),
    ],
)
def test_what_is_not_there_changes_nothing(
    driver: ViewController, what: str, values: dict[str, Any], error: type[Exception], tmp_path: Path
) -> None:
    ran, file = tmp_path / "ran", tmp_path / "mine.py"
    file.write_text(f"open({str(ran)!r}, 'w')", encoding="utf-8")
    values = values | {"name": values["name"].replace("FILE.py", str(file))}
    with pytest.raises(error):
        driver.handle(Request(what, values))
    after = walk(driver, 1)
    assert after["scenario"] == "flat"
    assert [robot["policy"] for robot in after["robots"]] == ["trot"]
    assert after["time"] == 0.01
    assert not ran.exists()  # no page can run code on this machine


def test_a_policy_that_fails_is_said_and_stands(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(FAILING, encoding="utf-8")
    with closing(ViewController([f"{file}:Failing"])) as own:
        assert walk(own, 5)["robots"][0]["outcome"] == "undecided until 10 s"
        (robot,) = walk(own, 20)["robots"]
        assert robot["failed"]
        assert "policy error" in robot["outcome"]
        assert "ZeroDivisionError" in robot["story"][0]


def test_a_policy_that_sees_the_ground_begins_an_episode_with_it(driver: ViewController) -> None:
    walk(driver, 5)
    blind = driver.sessions[0].latest.observation.shape[1]
    driver.handle(Request("policy", {"robot": 0, "name": "mpc_wbc_sighted"}))
    assert driver.sessions[0].latest.observation.shape[1] > blind
    state = walk(driver, 1)
    assert (state["time"], state["seed"], state["command"]) == (0.01, 0, [0.0, 0.0, 0.0])
