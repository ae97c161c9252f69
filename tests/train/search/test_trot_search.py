"""The trot's search: its fits by hand, its panel of candidates, what it bills, and what it refuses."""

import dataclasses
import json
import math

import numpy as np
import pytest
from train.search.evolution import decode, encode
from train.search.outcome import check
from train.search.trot_cost import (
    ERROR_SCALES,
    Panel,
    cost,
    interval_response,
    judge,
    mapped,
    unless_weak,
)

import policies
from evaluate.measures.metrics import Measures
from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.rollout import run
from policies.parameters import likewise
from policies.trot.open_loop import PARAMETERS_FILE, SEARCH_RANGES, Trot, TrotParameters, searched_parameters
from quad_env import OBSERVATION_SIZE
from quad_env.seeding import episode_seeds
from tests.quad_env.robots.alike import alike
from train.__main__ import main
from train.scenarios import practice
from train.search import trot as search_trot
from train.search import trot_cost
from train.search.command_map import WEAKNESS_WEIGHT, undone
from train.search.trot import Options

COMMANDS = np.random.default_rng(0).uniform(-1, 1, (6, 2, 3))
RESPONSE = np.array([[0.8, 0.0, 0.1], [0.0, 0.5, 0.3], [0.0, 0.0, 2.0], [-0.1, 0.0, 0.0]])
"""Rows: forward, lateral and yaw command, and one; columns: what is achieved."""


def measures(**changes):
    """Of six episodes with two command intervals, all walked to their end."""
    achieved = COMMANDS @ RESPONSE[:3] + RESPONSE[3]
    nothing = {field.name: np.zeros(6) for field in dataclasses.fields(Measures)}
    return Measures(**nothing | {"commands": COMMANDS, "mean_velocities": achieved} | changes)


def test_the_response_is_the_linear_map_that_made_the_velocities():
    np.testing.assert_allclose(interval_response(measures()), RESPONSE, atol=1e-12)


def test_intervals_that_ended_in_a_fall_do_not_count_and_too_few_others_are_no_response():
    velocities = measures().mean_velocities.copy()
    velocities[:2, 1] = math.nan
    np.testing.assert_allclose(interval_response(measures(mean_velocities=velocities)), RESPONSE, atol=1e-12)
    velocities[2:5, 1] = math.nan  # 7 of 12 are left
    assert not interval_response(measures(mean_velocities=velocities)).any()


def test_the_map_undoes_the_response():
    """By hand, from a gait that is asked for twice the yaw rate before."""
    found = undone(dataclasses.replace(TrotParameters(), yaw_gain=2.0), RESPONSE)
    assert found.forward_gain == pytest.approx(1 / 0.8)
    assert found.forward_bias == pytest.approx(0.1 / 0.8)
    assert found.lateral_gain == pytest.approx(1 / 0.5)
    assert found.yaw_gain == pytest.approx(2.0 / 2.0)
    assert found.yaw_per_lateral == pytest.approx((0.0 - 2.0 * 0.3 / 2.0) / 0.5)


def test_asking_through_the_map_achieves_the_command():
    """The response is that of a gait with the plain map: forward, lateral and yaw rate asked for are the commands."""
    found = undone(TrotParameters(), RESPONSE)
    forward, lateral, yaw_rate = 0.7, -0.4, 0.9
    asked = (
        found.forward_gain * forward + found.forward_bias,
        found.lateral_gain * lateral,
        found.yaw_gain * yaw_rate + found.yaw_per_lateral * lateral,
    )
    achieved = np.array([*asked, 1.0]) @ RESPONSE
    # The map leaves alone what forward walking does to the yaw rate.
    np.testing.assert_allclose(achieved, [forward, lateral, yaw_rate + 0.1 * asked[0]])


def test_a_response_too_weak_to_be_undone_leaves_the_map_alone(monkeypatch):
    assert unless_weak(TrotParameters(), np.zeros((4, 3))) == TrotParameters()
    beyond = np.eye(4, 3)
    beyond[3, 0] = math.inf  # a bias that no trot's parameters may have
    assert unless_weak(TrotParameters(), beyond) == TrotParameters()
    monkeypatch.setattr("train.search.trot_cost.run", lambda *_, **__: None)
    monkeypatch.setattr("train.search.trot_cost.measure", lambda _: measures())
    assert mapped(TrotParameters(), episode_seeds("search", 0, 6), 1).lateral_gain == pytest.approx(2.0)


def test_a_panel_is_its_members_each_on_its_own_rows():
    members = [TrotParameters(frequency=2.0), TrotParameters(duty=0.6)]
    panel, alone = Panel([Trot(each) for each in members]), [Trot(each) for each in members]
    panel.reset(6)
    for member in alone:
        member.reset(3)
    for step in range(30):
        observation = np.random.default_rng(step).normal(size=(6, OBSERVATION_SIZE)).astype(np.float32)
        expected = [member.act(observation[3 * i : 3 * i + 3]) for i, member in enumerate(alone)]
        np.testing.assert_array_equal(panel.act(observation), np.concatenate(expected))


def test_in_blocks_a_member_has_its_share_of_each():
    members = [TrotParameters(frequency=2.0), TrotParameters(duty=0.6)]
    panel, alone = Panel([Trot(each) for each in members], blocks=3), [Trot(each) for each in members]
    panel.reset(12)
    observation = np.random.default_rng(0).normal(size=(12, OBSERVATION_SIZE)).astype(np.float32)
    actions = panel.act(observation)
    for member, rows in zip(alone, ([0, 1, 4, 5, 8, 9], [2, 3, 6, 7, 10, 11]), strict=True):
        member.reset(6)
        np.testing.assert_array_equal(actions[rows], member.act(observation[rows]))


def test_a_point_of_the_cube_is_a_set_of_parameters_and_back():
    point = np.linspace(0.1, 0.9, len(SEARCH_RANGES))
    parameters = decode(point, TrotParameters(forward_gain=1.5), SEARCH_RANGES)
    np.testing.assert_allclose(encode(parameters, SEARCH_RANGES), point, atol=1e-12)
    assert parameters.forward_gain == 1.5
    for end, corner in enumerate((np.zeros(len(SEARCH_RANGES)), np.ones(len(SEARCH_RANGES)))):
        for name, bounds in SEARCH_RANGES.items():
            assert getattr(decode(corner, TrotParameters(), SEARCH_RANGES), name) == pytest.approx(bounds[end])


def test_the_cost_is_the_mean_of_the_scaled_errors():
    ones = {name: np.repeat([0.0, 2 * scale, 4 * scale], 2) for name, scale in ERROR_SCALES.items()}
    np.testing.assert_allclose(cost(measures(**ones), 3), [0.0, 8.0, 16.0])


def test_a_robot_that_fell_at_once_is_billed_all_the_overspeed_there_is():
    overspeed = np.array([math.nan, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(cost(measures(overspeed=overspeed), 3), [0.5 / 0.02, 0.0, 0.0])


def test_a_candidate_that_stands_still_is_billed():
    """A gait that is asked for nothing keeps its own, empty response to perfection; that must not pay."""
    still = dataclasses.replace(TrotParameters(), forward_gain=0.0, lateral_gain=0.0, yaw_gain=0.0)
    walking, standing = judge([TrotParameters(), still], episode_seeds("search", 0, 8), 600, 1)
    assert standing - walking > WEAKNESS_WEIGHT


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("--steps 100", "--steps must be from 101"),
        ("--seed -1", "--seed must be from 0"),
        ("--candidates 3", "--candidates must be from 4"),
        ("--check-episodes 3", "--check-episodes must be from 4"),
        ("--threads 0", "--threads must be from 1"),
        ("--out .", "must be a file"),
        ("--out TROT.md", "must be a file"),
        ("--out no-such-folder/trot.json", "no folder"),
        ("--steps many", "steps"),
    ],
)
def test_bad_input_is_one_line(arguments, complaint, capsys):
    assert main(["search", "trot", *arguments.split()]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert complaint in line


TINY = "--generations 1 --candidates 4 --episodes 8 --steps 101 --check-episodes 4 --threads 1"


def test_a_search_writes_parameters_that_walk_and_its_account(tmp_path):
    out = tmp_path / "trot.json"
    assert main(["search", "trot", *TINY.split(), "--out", str(out)]) == 0
    found = TrotParameters(**json.loads(out.read_text(encoding="utf-8")))
    assert Trot(found).act(np.zeros(OBSERVATION_SIZE, np.float32)).shape == (12,)
    account = (tmp_path / "TROT.md").read_text(encoding="utf-8")
    assert f"| duty | 0.45 … 0.65 | 0.48 | {found.duty:g} |" in account
    assert len([line for line in account.splitlines() if "| after |" in line]) == 1 + 3


def test_an_outcome_that_cannot_be_written_is_printed(tmp_path, monkeypatch, capsys):
    def full(*_):
        raise OSError(28, "No space left on device")

    after = dataclasses.replace(TrotParameters(), duty=0.5125)
    monkeypatch.setattr(search_trot, "search", lambda *_: after)
    monkeypatch.setattr(search_trot, "account", lambda *_: "the account")
    monkeypatch.setattr("train.search.outcome.write_atomically", full)
    assert main(["search", "trot", "--out", str(tmp_path / "trot.json")]) == 2
    printed = capsys.readouterr()
    (line,) = printed.err.strip().splitlines()
    assert "No space left" in line
    parameters, _ = json.JSONDecoder().raw_decode(printed.out)
    assert TrotParameters(**parameters) == after
    assert "the account" in printed.out


def test_ctrl_c_in_a_search_is_130_and_writes_nothing(tmp_path, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(search_trot, "search", interrupted)
    assert main(["search", "trot", "--out", str(tmp_path / "trot.json")]) == 130
    assert not list(tmp_path.iterdir())


def test_the_defaults_can_be_searched_with():
    check(Options(), PARAMETERS_FILE)
    assert policies.make("trot").name == "trot"


def test_a_robots_search_goes_to_its_own_folder_and_begins_with_its_own_size(tmp_path, capsys):
    robot = alike(tmp_path)
    path = tmp_path / "alike.xml"
    assert main(["search", "trot", *TINY.split(), "--robot", str(path)]) == 0
    own = tmp_path / "alike"
    told = (own / "TROT.md").read_text(encoding="utf-8")
    assert f"search trot --seed 0 --robot {path}" in told
    start, found = likewise(searched_parameters(), robot), json.loads((own / "trot.json").read_text(encoding="utf-8"))
    assert f"| blend_time | fixed | {start.blend_time:.9g} | {found['blend_time']:.9g} |" in told
    low, high = (robot.leg_length / 0.6 * end for end in SEARCH_RANGES["body_height"])
    assert low <= found["body_height"] <= high < 0.22
    assert policies.make("trot", robot=robot).parameters == TrotParameters(**found)
    assert main(["search", "trot", "--robot", "go9"]) == 2
    assert "unknown robot" in capsys.readouterr().err


def test_candidates_walk_as_the_robot_on_its_own_ground(tmp_path, monkeypatch):
    """At the call site: which robot, which scenario and which policy are really run."""
    robot, seen = alike(tmp_path), []
    hardware = Hardware(robot=str(tmp_path / "alike.xml"))

    def watched(policy, scenario, seeds, **options):
        seen.append((policy.robot, scenario, options["hardware"]))
        return run(policy, scenario, seeds, **options)

    monkeypatch.setattr(trot_cost, "run", watched)
    judge([searched_parameters(robot)], episode_seeds("search", 0, 8), 101, 1, hardware)
    assert all(each == robot for each, _, _ in seen)
    assert all(each == hardware for _, _, each in seen)
    assert {each.name: each for _, each, _ in seen} == {
        name: practice(name, "search", robot=robot) for name in trot_cost.SCENARIO_WEIGHTS
    }
