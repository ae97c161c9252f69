"""The search of trot_feedback's gains: its exercises, what it bills, what it writes, keeps and refuses."""

import dataclasses
import json

import numpy as np
import pytest

from policies.trot.feedback_parameters import LIMITS, PARAMETERS_FILE, FeedbackParameters, searched_parameters
from quad_env.scenarios.axes import AXES
from quad_env.seeding import episode_seeds
from train.__main__ import main
from train.search import feedback as search_feedback
from train.search import feedback_cost
from train.search.feedback import ACCOUNT
from train.search.feedback_cost import EXERCISES, Exercise, judge, walked

TINY = "--generations 1 --candidates 4 --episodes 1 --steps 400 --check-episodes 4 --threads 1"


@pytest.fixture
def two_exercises(monkeypatch):
    few = (Exercise("flat", 1.5, 1.0), Exercise("push", 90.0, 0.1))
    monkeypatch.setattr(search_feedback, "EXERCISES", few)
    monkeypatch.setattr(feedback_cost, "EXERCISES", few)


@pytest.mark.parametrize("exercise", EXERCISES, ids=lambda exercise: exercise.name)
def test_nobody_searches_on_the_ground_of_the_exam(exercise):
    exam = AXES[exercise.axis].scenario(exercise.severity, exercise.name)
    for short in (False, True):
        scenario = exercise.scenario(short=short)
        if exercise.axis == "rough":
            assert scenario.terrain.seed != exam.terrain.seed
            assert dataclasses.replace(scenario.terrain, seed=exam.terrain.seed) == exam.terrain
        else:
            assert scenario.terrain == exam.terrain
        if scenario.pushes:
            assert scenario.pushes.impulse == exam.pushes.impulse


def test_the_account_is_of_the_parameters_in_force_and_of_the_start_in_the_code():
    text = PARAMETERS_FILE.with_name(ACCOUNT).read_text()
    cells = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
    told = {row[1]: (float(row[3]), float(row[4])) for row in cells if len(row) == 6 and row[1] in LIMITS}
    start, found = dataclasses.asdict(FeedbackParameters()), dataclasses.asdict(searched_parameters())
    assert set(told) == set(LIMITS)
    for name, columns in told.items():
        assert columns == pytest.approx((start[name], found[name]), rel=1e-4), name


def test_a_short_episode_has_its_push_and_two_commands():
    short = Exercise("push", 90.0, 1.0).scenario(short=True)
    assert short.pushes.window[1] <= 2 * short.commands.interval


def test_spoilt_gains_cost_more():
    good = searched_parameters()
    changes = ({"forward_gain": 0.3, "integral_gain": 0.0}, {"stance_push": -0.2}, {"tilt_gain": -1.0})
    spoilt = [dataclasses.replace(good, **change) for change in changes]
    first, *others = judge([good, *spoilt], episode_seeds("search", 9, 8), 500, 2)
    assert min(others) > first + 1.0


def test_falls_are_billed_where_the_exercise_is_about_them(monkeypatch):
    members, seeds = [searched_parameters(), FeedbackParameters(body_height=0.2, capture_gain=0.0)], np.arange(8)
    bills = []
    for fall_cost in (0.0, 24.0):
        monkeypatch.setattr(feedback_cost, "EXERCISES", (Exercise("push", 120.0, 0.5, fall_cost),))
        bills.append(judge(members, seeds, 500, 1))
    falls = (bills[1] - bills[0]) / (0.5 * 24.0 / len(seeds))
    np.testing.assert_allclose(falls, np.round(falls), atol=1e-9)
    assert (falls > 0).all()
    assert (falls <= 8).all()


def test_members_are_measured_one_after_the_other():
    good, slow = searched_parameters(), dataclasses.replace(searched_parameters(), forward_gain=0.3, integral_gain=0.0)
    seeds = episode_seeds("search", 9, 4)
    found = walked([good, slow], Exercise("flat", 1.5, 1.0), seeds, 1)
    np.testing.assert_array_equal(found.commands[:4], found.commands[4:])
    assert (found.velocity_error[:4] < found.velocity_error[4:]).all()


@pytest.mark.usefixtures("two_exercises")
def test_a_search_writes_parameters_and_its_account_and_is_the_same_again(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        assert main(["search", "feedback", *TINY.split(), "--out", str(tmp_path / name / "found.json")]) == 0
    one, two = ((tmp_path / name / "found.json").read_text() for name in ("one", "two"))
    assert one == two
    found = FeedbackParameters(**json.loads(one))
    assert found != FeedbackParameters()
    account = (tmp_path / "one" / ACCOUNT).read_text()
    assert f"| duty | 0.4 … 0.65 | {FeedbackParameters().duty:g} | {found.duty:g} |" in account
    assert "| blend_time | fixed |" in account
    assert len([line for line in account.splitlines() if "| after |" in line]) == 1 + 2


@pytest.mark.usefixtures("two_exercises")
def test_ctrl_c_keeps_what_was_found_so_far(tmp_path, monkeypatch, capsys):
    better = dataclasses.replace(FeedbackParameters(), duty=0.5125)

    def search(*_):
        yield better
        raise KeyboardInterrupt

    monkeypatch.setattr(search_feedback, "search", search)
    out = tmp_path / "found.json"
    assert main(["search", "feedback", "--out", str(out)]) == 130
    assert FeedbackParameters(**json.loads(out.read_text())) == better
    assert not (tmp_path / ACCOUNT).exists()
    assert "kept what was found after 1 generations" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("--steps 300", "--steps must be from 400"),
        ("--candidates 3", "--candidates must be from 4"),
        ("--spread 0", "--spread must be from"),
        ("--spread nan", "--spread must be from"),
        ("--start no-such.json", "no-such.json"),
        ("--out .", "must be a file"),
        ("--out no-such-folder/found.json", "no folder"),
    ],
)
def test_bad_input_is_one_line(arguments, complaint, capsys):
    assert main(["search", "feedback", *arguments.split()]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert complaint in line
