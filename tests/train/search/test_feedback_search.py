"""The search of trot_feedback's gains: its exercises, what it bills, what it writes, keeps and refuses."""

import dataclasses
import json

import numpy as np
import pytest

from policies.parameters import limits_of
from policies.trot.feedback_parameters import PARAMETERS_FILE, FeedbackParameters, searched_parameters
from quad_env.scenarios.axes import AXES
from quad_env.seeding import episode_seeds
from train.__main__ import main
from train.search import feedback as search_feedback
from train.search import feedback_cost
from train.search.feedback import ACCOUNT, ADOPTED, KEPT, Comparison, moved
from train.search.feedback_cost import EXERCISES, HISTORY, Exercise, judge, walked

TINY = "--generations 1 --candidates 4 --episodes 1 --steps 400 --check-episodes 4 --threads 1"


@pytest.fixture
def one_exercise(monkeypatch):
    few = (Exercise("flat", 1.5, 1.0),)
    monkeypatch.setattr(search_feedback, "EXERCISES", few)
    monkeypatch.setattr(feedback_cost, "EXERCISES", few)
    monkeypatch.setattr(feedback_cost, "STEPS", 200)


@pytest.mark.parametrize("exercise", EXERCISES, ids=lambda exercise: exercise.name)
def test_nobody_searches_on_the_ground_of_the_exam(exercise):
    exam = AXES[exercise.axis].scenario(exercise.severity, exercise.name)
    for purpose in ("search", "validation"):
        scenario = exercise.scenario(purpose)
        if exercise.axis == "rough":
            assert scenario.terrain.seed != exam.terrain.seed
            assert dataclasses.replace(scenario.terrain, seed=exam.terrain.seed) == exam.terrain
        else:
            assert scenario.terrain == exam.terrain
        if scenario.pushes:
            assert scenario.pushes.impulse == exam.pushes.impulse


def told(text):
    """The start and the outcome that an account tells of."""
    cells = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
    rows = {row[1]: row for row in cells if len(row) == 6 and row[1] in limits_of(FeedbackParameters)}
    return tuple(FeedbackParameters(**{name: float(row[column]) for name, row in rows.items()}) for column in (3, 4))


def test_the_parameters_in_force_are_those_that_the_account_says_and_it_starts_from_those_in_the_code():
    text = PARAMETERS_FILE.with_name(ACCOUNT).read_text()
    start, outcome = told(text)
    assert start == FeedbackParameters()
    assert searched_parameters() == (start if KEPT in text else outcome)
    assert moved(start, outcome) in text
    assert HISTORY in text


def test_a_short_episode_has_its_push_and_two_commands():
    short = Exercise("push", 90.0, 1.0).scenario("search")
    assert short.pushes.window[1] <= 2 * short.commands.interval


def test_spoilt_gains_cost_more(monkeypatch):
    monkeypatch.setattr(feedback_cost, "EXERCISES", (Exercise("flat", 1.5, 10.0), Exercise("slope", 20.0, 0.15)))
    good = searched_parameters()
    changes = ({"forward_gain": 0.3, "integral_gain": 0.0}, {"stance_push": -0.2}, {"tilt_gain": -1.0})
    spoilt = [dataclasses.replace(good, **change) for change in changes]
    first, *others = judge([good, *spoilt], episode_seeds("search", 9, 4), 400, 2)
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


@pytest.mark.usefixtures("one_exercise")
def test_a_search_writes_parameters_and_its_account_and_is_the_same_again(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        assert main(["search", "feedback", *TINY.split(), "--out", str(tmp_path / name / "found.json")]) == 0
    one, two = ((tmp_path / name / "found.json").read_text() for name in ("one", "two"))
    assert one == two
    account = (tmp_path / "one" / ACCOUNT).read_text()
    start, outcome = told(account)
    assert start == FeedbackParameters() != outcome
    assert FeedbackParameters(**json.loads(one)) == (outcome if ADOPTED in account else start)
    assert "| blend_time | fixed |" in account
    assert len([line for line in account.splitlines() if "| after |" in line]) == 1 + 1


@pytest.mark.usefixtures("one_exercise")
def test_an_outcome_that_is_no_better_on_validation_episodes_leaves_the_start(tmp_path, monkeypatch):
    outcome = dataclasses.replace(FeedbackParameters(), forward_gain=0.4, integral_gain=0.0)
    monkeypatch.setattr(search_feedback, "search", lambda *_: iter([outcome]))
    seen = []
    monkeypatch.setattr(search_feedback, "walked", lambda *arguments: seen.append(arguments[2]) or walked(*arguments))
    out = tmp_path / "found.json"
    assert main(["search", "feedback", *TINY.split(), "--out", str(out)]) == 0
    assert FeedbackParameters(**json.loads(out.read_text())) == FeedbackParameters()
    assert KEPT in (tmp_path / ACCOUNT).read_text()
    for seeds in seen:
        np.testing.assert_array_equal(seeds, episode_seeds("validation", 0, 4))


def test_an_outcome_is_better_where_it_costs_less_on_most_seeds_and_not_by_chance():
    assert Comparison((), np.full(8, -1.0)).better  # all of 2^8 signs but two cost less: p = 2 / 256
    assert not Comparison((), np.full(8, 1.0)).better
    assert not Comparison((), np.array([-2.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0])).better


def test_how_far_parameters_moved_is_told_in_shares_of_their_ranges():
    """By hand: 0.75 of 3 … 9 Hz is 12.5 %, and 0.0125 of 0.4 … 0.65 is 5 %; all others stay."""
    start = FeedbackParameters()
    outcome = dataclasses.replace(start, frequency=start.frequency + 0.75, duty=start.duty - 0.0125)
    text = moved(start, outcome)
    assert "0.0% of their range in the median" in text
    assert "most of all frequency (12.5%), duty (5.0%)" in text


@pytest.mark.usefixtures("one_exercise")
def test_ctrl_c_keeps_what_was_found_so_far(tmp_path, monkeypatch, capsys):
    better = dataclasses.replace(FeedbackParameters(), duty=0.5125)

    def search(*_):
        yield better
        raise KeyboardInterrupt

    monkeypatch.setattr(search_feedback, "search", search)
    out = tmp_path / "found.json"
    assert main(["search", "feedback", "--out", str(out)]) == 130
    assert FeedbackParameters(**json.loads((tmp_path / "found.unjudged.json").read_text())) == better
    assert not out.exists()
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
