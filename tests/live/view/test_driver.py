"""What can be done with the robots of a view while they walk, and that what cannot be done changes nothing."""

import shutil
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from evaluate.rollouts.hardware import Hardware
from live.view.driver import KEPT_EVENTS, Driver, Start
from live.view.requests import REQUESTS, Request
from live.view.telemetry import KEPT_ROWS, Telemetry
from policies.base import PolicyError
from quad_env.cli.command_line import UsageError

FAILING = """
import numpy as np

from policies.base import Policy


class Failing(Policy):
    name = "failing"

    def _act(self, observation):
        self.steps = getattr(self, "steps", 0) + 1
        if self.steps > 15:
            raise RuntimeError("not today")
        return np.tile(self.robot.home_pose, (len(observation), 1))
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
"""Arguments of requests; the others take none, or an `on`."""


@pytest.fixture
def driver(tmp_path: Path) -> Iterator[Driver]:
    start = Start(("trot",), "flat", Hardware(), tmp_path / "recordings", command=(0.0, 0.0, 0.0))
    with closing(Driver(start)) as found:
        found.do(Request("speed", {"factor": 10.0}))
        yield found


def walk(driver: Driver, steps: int) -> dict[str, Any]:
    for _ in range(steps):
        assert driver.move()
    return driver.state()


def test_every_request_is_done(driver: Driver) -> None:
    for name, wanted in REQUESTS.items():
        if name != "record":
            values = RIGHTLY.get(name) or ({"on": True} if "on" in wanted else {})
            driver.do(Request(name, values))
            assert set(values) == set(wanted)
    driver.do(Request("pause", {"on": False}))
    assert walk(driver, 3)["scenario"] == "slope=10"


def test_it_walks_where_it_is_steered_and_tells_so(driver: Driver) -> None:
    driver.do(Request("steer", {"forward": 0.5, "left": 0.0, "turn": 0.6}))
    state = walk(driver, 200)
    assert state["command"] == [0.5, 0.0, 0.6]
    assert state["robots"][0]["velocity"][0] == pytest.approx(0.5, abs=0.25)
    assert len(state["rows"]) == 200
    time, command, velocity, contacts, torque, reward, correction = state["rows"][-1]
    infos = driver.session.latest.infos
    assert time == 2.0
    assert command == [0.5, 0.0, 0.6]
    assert velocity == pytest.approx(infos["heading_velocity"][0], abs=1e-3)
    assert contacts == infos["foot_contact"][0].astype(int).tolist()
    assert torque == pytest.approx(np.abs(infos["joint_torque"][0]).max() / 100.0, abs=1e-3)
    assert reward == pytest.approx(sum(state["robots"][0]["rewards"].values()), abs=2e-3)
    assert correction is None
    assert driver.state()["rows"] == []


def test_it_turns_left_when_told_to_turn_left(driver: Driver) -> None:
    before = driver.state()["robots"][0]["heading"]
    driver.do(Request("steer", {"forward": 0.0, "left": 0.0, "turn": 0.8}))
    after = walk(driver, 150)["robots"][0]["heading"]
    assert 20.0 < (after - before) % 360.0 < 90.0


@pytest.mark.parametrize(("direction", "axis", "sign"), [(0.0, 0, 1), (90.0, 1, 1), (-90.0, 1, -1)])
def test_a_push_goes_the_way_it_is_given_seen_from_the_robot(
    driver: Driver, direction: float, axis: int, sign: int
) -> None:
    driver.do(Request("steer", {"forward": 0.0, "left": 0.0, "turn": 0.8}))
    walk(driver, 150)  # so that ahead is not the world's x
    driver.do(Request("push", {"direction": direction, "impulse": 12.0}))
    state = walk(driver, 10)
    heading = np.radians(state["robots"][0]["heading"])
    x, y = driver.session.latest.infos["push"][0]
    own = (np.cos(heading) * x + np.sin(heading) * y, -np.sin(heading) * x + np.cos(heading) * y)
    assert own[axis] == pytest.approx(sign * 120.0, rel=0.05)  # 12 N·s in 0.1 s
    assert "pushed by hand, 12 N·s" in state["events"]
    walk(driver, 1)
    assert not driver.session.latest.infos["push"].any()


def test_again_is_the_same_episode_to_the_bit_whatever_began_it(driver: Driver) -> None:
    def positions() -> list[float]:
        walk(driver, 30)
        return [float(value) for value in driver.session.latest.infos["position"].ravel()]

    driver.do(Request("steer", {"forward": 0.5, "left": 0.0, "turn": 0.0}))
    for begin in (
        Request("scenario", {"name": "push"}),
        Request("compare", {"on": True}),
        Request("compare", {"on": False}),
        Request("let_go", {}),
        Request("scenario", {"name": "rough"}),
    ):
        driver.do(begin)
        if begin.do == "let_go":
            continue
        found = positions()
        driver.do(Request("reset", {"seed": driver.session.seed}))
        assert positions() == found
    start = Start(("trot",), "push", Hardware(), Path(), command=(0.5, 0.0, 0.0))
    with closing(Driver(start)) as fresh:
        driver.do(Request("scenario", {"name": "push"}))
        driver.do(Request("steer", {"forward": 0.5, "left": 0.0, "turn": 0.0}))
        driver.do(Request("reset", {"seed": 0}))
        walk(fresh, 30)
        assert fresh.session.latest.infos["position"].ravel().tolist() == positions()


def test_rows_are_of_the_present_episode_and_name_the_feet_in_their_order(driver: Driver) -> None:
    for _ in range(5):
        driver.move()
    driver.do(Request("next", {}))
    assert len(walk(driver, 2)["rows"]) == 2
    telemetry, step = Telemetry(100.0), driver.session.latest
    lifted = replace(step, infos={**step.infos, "foot_contact": np.array([[True, False, False, False]])})
    telemetry.note(lifted, driver.session.policies[0])
    assert telemetry.rows()[0][3] == [1, 0, 0, 0]


def test_while_nobody_looks_no_more_is_kept_than_a_page_shows(driver: Driver) -> None:
    for _ in range(KEPT_ROWS + 20):
        driver.move()
    for _ in range(KEPT_EVENTS + 5):
        driver.do(Request("push", {"direction": 0.0, "impulse": 0.0}))
    state = driver.state()
    assert len(state["rows"]) == KEPT_ROWS
    assert state["rows"][-1][0] == state["time"]
    assert len(state["events"]) == KEPT_EVENTS


def test_paused_it_stands_still_but_for_single_steps(driver: Driver) -> None:
    walk(driver, 5)
    driver.do(Request("pause", {"on": True}))
    assert not driver.move()
    driver.do(Request("step", {}))
    assert driver.move()
    assert not driver.move()
    assert driver.state()["time"] == 0.06


def test_two_robots_walk_the_same_episode_each_by_its_policy(driver: Driver) -> None:
    driver.do(Request("policy", {"robot": 0, "name": "stand"}))
    driver.do(Request("scenario", {"name": "rough"}))
    driver.do(Request("compare", {"on": True}))
    state = walk(driver, 5)
    assert [robot["policy"] for robot in state["robots"]] == ["stand", "trot"]
    assert state["scenario"] == "rough"
    driver.do(Request("compare", {"on": False}))
    assert len(driver.state()["robots"]) == 1


def test_a_command_outlives_a_change_of_scenario_until_it_is_given_back(driver: Driver) -> None:
    driver.do(Request("steer", {"forward": 0.4, "left": 0.1, "turn": 0.0}))
    driver.do(Request("scenario", {"name": "slope=10"}))
    assert walk(driver, 1)["command"] == [0.4, 0.1, 0.0]
    driver.do(Request("let_go", {}))
    driver.do(Request("next", {}))
    state = walk(driver, 1)
    assert not state["by_hand"]
    assert state["command"] != [0.4, 0.1, 0.0]


@pytest.mark.parametrize(
    ("what", "values", "error"),
    [
        ("policy", {"robot": 0, "name": "nobody"}, PolicyError),
        ("policy", {"robot": 1, "name": "trot"}, ValueError),
        ("policy", {"robot": 0, "name": "/etc"}, PolicyError),
        ("policy", {"robot": 0, "name": "FILE.py:Planted"}, PolicyError),
        ("scenario", {"name": "FILE.py:planted"}, ValueError),
        ("scenario", {"name": "nowhere"}, ValueError),
        ("scenario", {"name": "push:all"}, ValueError),
        ("scenario", {"name": "slope=800"}, ValueError),
    ],
)
def test_what_is_not_there_changes_nothing(
    driver: Driver, what: str, values: dict[str, Any], error: type[Exception], tmp_path: Path
) -> None:
    ran, file = tmp_path / "ran", tmp_path / "mine.py"
    file.write_text(f"open({str(ran)!r}, 'w')", encoding="utf-8")
    values = values | {"name": values["name"].replace("FILE.py", str(file))}
    before = walk(driver, 3)
    with pytest.raises(error):
        driver.do(Request(what, values))
    after = walk(driver, 1)
    assert after["scenario"] == before["scenario"]
    assert [robot["policy"] for robot in after["robots"]] == ["trot"]
    assert after["time"] == pytest.approx(before["time"] + 0.01)
    assert not ran.exists()  # no page has code of this machine run


def test_recordings_begin_and_end_under_way_and_none_is_written_over(driver: Driver, tmp_path: Path) -> None:
    for number in (1, 2):
        driver.do(Request("record", {"on": True}))
        assert driver.state()["recording"].endswith(f"flat-trot-{number}.mcap")
        walk(driver, 20)
        driver.do(Request("scenario", {"name": "flat"}))  # goes on into a new episode
        walk(driver, 20)
        driver.do(Request("record", {"on": False}))
        assert driver.state()["recording"] == ""
    files = sorted((tmp_path / "recordings").iterdir())
    assert [file.name for file in files] == ["flat-trot-1.mcap", "flat-trot-2.mcap"]
    assert all(file.stat().st_size > 10_000 for file in files)


def test_a_recording_tells_what_was_done_and_goes_on_with_other_policies_and_scenarios(
    driver: Driver, tmp_path: Path
) -> None:
    driver.record(tmp_path / "walk.mcap")
    walk(driver, 9)
    driver.do(Request("policy", {"robot": 0, "name": "residual"}))
    walk(driver, 10)
    driver.do(Request("scenario", {"name": "slope=10"}))
    walk(driver, 10)
    driver.do(Request("record", {"on": False}))
    with (tmp_path / "walk.mcap").open("rb") as file:
        reader, decoders = make_reader(file), DecoderFactory()
        told = [
            (message.log_time // 10_000_000, decoders.decoder_for("cdr", schema)(message.data).msg)
            for schema, _, message in reader.iter_messages(topics="/events")
        ]
        corrected = [message.log_time // 10_000_000 for *_, message in reader.iter_messages(topics="/correction")]
    done = [line for line in told if not line[1].startswith("command")]
    assert done == [(8, "residual chosen"), (18, "slope=10, residual"), (19, "reset")]
    assert corrected == list(range(9, 30))


def lose_the_recording(driver: Driver, folder: Path) -> None:
    """Have what is recorded nowhere to be written to, and walk until that is noticed."""
    shutil.rmtree(folder)
    for _ in range(1000):
        driver.move()
        if not driver.state()["recording"]:
            return
        time.sleep(0.01)
    raise AssertionError("it records on")


def test_a_pages_recording_that_can_be_written_no_longer_ends_and_the_robots_walk_on(
    driver: Driver, tmp_path: Path
) -> None:
    driver.do(Request("record", {"on": True}))
    lose_the_recording(driver, tmp_path / "recordings")
    before = driver.state()["time"]
    assert walk(driver, 2)["time"] == pytest.approx(before + 0.02)


def test_one_that_was_asked_for_at_the_start_ends_the_view(driver: Driver, tmp_path: Path) -> None:
    driver.record(tmp_path / "own" / "walk.mcap")
    with pytest.raises(OSError, match="No such file"):
        lose_the_recording(driver, tmp_path / "own")


def test_a_policy_that_fails_is_said_and_stands(driver: Driver, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(FAILING, encoding="utf-8")
    with closing(Driver(Start((f"{file}:Failing",), "flat", Hardware(), tmp_path))) as own:
        assert walk(own, 5)["robots"][0]["failure"] == ""
        assert "not today" in walk(own, 20)["robots"][0]["failure"]


def test_a_policy_that_sees_the_ground_begins_anew_with_it(driver: Driver) -> None:
    walk(driver, 5)
    blind = driver.session.latest.observation.shape[1]
    driver.do(Request("policy", {"robot": 0, "name": "mpc_wbc_sighted"}))
    assert driver.session.latest.observation.shape[1] > blind
    state = walk(driver, 1)
    assert (state["time"], state["seed"], state["command"]) == (0.01, 0, [0.0, 0.0, 0.0])
    with pytest.raises(PolicyError, match="other ground heights"):
        driver.do(Request("compare", {"on": True}))
    assert len(walk(driver, 1)["robots"]) == 1


def test_a_recording_that_cannot_be_written_is_refused_and_the_robots_walk_on(driver: Driver, tmp_path: Path) -> None:
    (tmp_path / "recordings").write_text("a file where the folder should be", encoding="utf-8")
    with pytest.raises((UsageError, OSError)):
        driver.do(Request("record", {"on": True}))
    assert walk(driver, 2)["recording"] == ""
