"""A gait's search: its point of the cube, its fit by hand, what it bills, what it writes, what it refuses."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from train.search.evolution import decode, encode
from train.search.gait_cost import commands, cost, shared_walk

from policies.gaits.parameters import OFFSETS, GaitParameters, searched_parameters
from policies.parameters import limits_of
from quad_env.seeding import episode_seeds
from train.__main__ import main
from train.search.command_map import response, undone
from train.search.gait import RANGES


def test_ranges_are_of_the_parameters_and_within_their_limits():
    assert set(RANGES) == set(OFFSETS)
    for ranges in RANGES.values():
        for name, (low, high) in ranges.items():
            assert limits_of(GaitParameters)[name][0] <= low < high <= limits_of(GaitParameters)[name][1], name
    assert RANGES["walk"]["duty"][0] - RANGES["walk"]["duty_fall"][1] >= 0.75


def test_a_point_and_its_parameters_are_the_same():
    point = np.linspace(0.1, 0.9, len(RANGES["pronk"]))
    np.testing.assert_allclose(encode(decode(point, GaitParameters(), RANGES["pronk"]), RANGES["pronk"]), point)


def test_commands_stay_within_the_range_and_half_go_straight():
    drawn = commands("walk", 40, np.random.default_rng(0))
    assert (drawn[:20, 1:] == 0.0).all()
    np.testing.assert_allclose(drawn[[0, 19], 0], [0.12, 0.4])
    assert (np.abs(drawn) <= [0.4, 0.3, 0.6]).all()


def test_asking_through_the_map_achieves_the_command():
    """The robot answers u with v = 0.8 u + 0.1, lateral 0.5 u, yaw rate 2 u + 0.3 lateral u, from a plain map."""
    answer = np.array([[0.8, 0.0, 0.0], [0.0, 0.5, 0.3], [0.0, 0.0, 2.0], [0.1, 0.0, 0.0]])
    found = undone(GaitParameters(), answer)
    forward, lateral, yaw_rate = 0.6, -0.2, 0.5
    asked = np.array(
        [
            found.forward_gain * forward + found.forward_bias,
            found.lateral_gain * lateral,
            found.yaw_gain * yaw_rate + found.yaw_per_lateral * lateral,
            1.0,
        ]
    )
    np.testing.assert_allclose(asked @ answer, [forward, lateral, yaw_rate])


def test_response_is_the_map_that_made_the_velocities():
    command = np.random.default_rng(1).uniform(-1.0, 1.0, (9, 3))
    answer = np.random.default_rng(2).uniform(-1.0, 1.0, (4, 3))
    np.testing.assert_allclose(response(command, command @ answer[:3] + answer[3]), answer)


def test_a_spoilt_gait_costs_more():
    command = commands("trot", 8, np.random.default_rng(3))
    good = searched_parameters()["trot"]
    spoilt = [
        replace(good, **change) for change in ({"body_height": 0.12}, {"forward_gain": 0.3}, {"stance_shift": 0.12})
    ]
    first, *others = shared_walk("trot", [good, *spoilt], command, episode_seeds("search", 9, 8), 300, 2)
    assert all(cost(walk, command) > cost(first, command) + 0.5 for walk in others)


def test_it_replaces_its_gait_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("train.search.gait.MAP_EPISODES", 8)
    out = tmp_path / "gaits.json"
    assert main(["search", "gait", "--gait", "walk", "--generations", "0", "--steps", "250", "--out", str(out)]) == 0
    written, shipped = json.loads(out.read_text(encoding="utf-8")), searched_parameters()
    assert {name: GaitParameters(**written[name]) for name in OFFSETS if name != "walk"} == {
        name: shipped[name] for name in OFFSETS if name != "walk"
    }
    kept = asdict(shipped["walk"])
    assert all(written["walk"][name] == pytest.approx(kept[name], abs=1e-4) for name in RANGES["walk"])
    assert written["walk"]["forward_gain"] != kept["forward_gain"]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--gait", "gallop"], "--gait"),
        (["--gait", "walk", "--candidates", "1"], "--candidates"),
        (["--gait", "walk", "--out", "/nowhere/gaits.json"], "--out"),
    ],
)
def test_mistakes_are_one_line(arguments, word, capsys):
    assert main(["search", "gait", *arguments]) == 2
    complaint = capsys.readouterr().err
    assert len(complaint.splitlines()) == 1
    assert word in complaint
