"""The search for success: its scenarios, its cost, what it writes and keeps."""

import dataclasses
import itertools
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import policies
from evaluate.measures.metrics import Measures
from evaluate.measures.outcomes import DIVERGED, FELL, OFF_COMMAND, POLICY_ERROR, STALLED, SUCCEEDED
from policies.parameters import limits_of
from policies.residual_bases import BASES
from quad_env.seeding import episode_seeds
from train.__main__ import main
from train.search import feedback
from train.search.feedback import (
    ADOPTED,
    KEPT,
    OUTCOME_COSTS,
    POLICIES,
    candidate_costs,
    episode_costs,
    is_better,
    walked,
)

TINY = "--generations 1 --candidates 4 --episodes 1 --steps 101 --check-episodes 2 --threads 1 --exercises flat=1.5"
each_subject = pytest.mark.parametrize("name", POLICIES)
FORWARD, ASIDE, STILL, GONE = (1.0, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.0), (np.nan,) * 3


@pytest.fixture
def brief_judgement(monkeypatch):
    def brief(members, exercises, seeds, purpose, steps=101, threads=1):
        return walked(members, exercises, seeds, purpose, steps, threads)

    monkeypatch.setattr(feedback, "walked", brief)


def found(outcome, commands, velocities, *, error=0.0, overspeed=0.0):
    """An episode with these commands and mean velocities, an interval a row."""
    nothing = {field.name: np.zeros(1) for field in dataclasses.fields(Measures)}
    return Measures(
        **nothing
        | {"outcome": np.array([outcome], object), "velocity_error": np.array([error])}
        | {"overspeed": np.array([overspeed])}
        | {"commands": np.array([commands], float), "mean_velocities": np.array([velocities], float)}
    )


@pytest.mark.parametrize(
    ("episode", "cost"),
    [
        (found(SUCCEEDED, [FORWARD], [FORWARD]), 0.0),
        (found(SUCCEEDED, [FORWARD], [FORWARD], error=0.2), 0.15 * 0.1),
        (found(SUCCEEDED, [FORWARD], [FORWARD], overspeed=0.3), 0.1),
        # 0.35 m/s are allowed of 1 m/s: half of that is 1/8 of the largest deviation counted.
        (found(SUCCEEDED, [FORWARD], [(0.825, 0.0, 0.0)]), 0.25 / 8),
        # The worst interval counts: 0.5 rad/s off where 0.15 rad/s are allowed.
        (found(OFF_COMMAND, [FORWARD, STILL], [FORWARD, (0.0, 0.0, 0.45)]), 1.0 + 0.25 * 3 / 4),
        (found(OFF_COMMAND, [STILL], [(5.0, 0.0, 0.0)]), 1.25),
        (found(STALLED, [FORWARD], [STILL]), 1.5 + 0.25 * (1.0 / 0.35) / 4),
        (found(FELL, [FORWARD, GONE], [FORWARD, GONE], error=1.0), 2.0 + 0.25 + 0.15 / 2),
        (found(FELL, [GONE], [GONE], error=2.0, overspeed=np.nan), 2.5),
        (found(DIVERGED, [GONE], [GONE], error=2.0), 2.4),
    ],
)
def test_costs_by_hand(episode, cost):
    assert episode_costs(episode) == pytest.approx([cost])


amounts = st.fixed_dictionaries({"error": st.floats(0, 2), "overspeed": st.floats(0, 1)})
speeds = st.tuples(*[st.floats(-5, 5)] * 3)


@given(speeds, speeds, speeds, st.tuples(amounts, amounts))
def test_whatever_is_graded_the_outcomes_keep_their_order(command, one, other, graded):
    order = (SUCCEEDED, OFF_COMMAND, STALLED, POLICY_ERROR)
    for better, worse in itertools.pairwise(order):
        first = episode_costs(found(better, [command], [one], **graded[0]))
        assert first <= episode_costs(found(worse, [command], [other], **graded[1]))
    assert OUTCOME_COSTS[POLICY_ERROR] == OUTCOME_COSTS[FELL]


def test_exercises_are_walked_side_by_side_and_every_cost_is_that_of_the_member_alone():
    members = [policies.make("trot"), policies.make("stand")]
    seeds, pair = episode_seeds("search", 9, 2), ("flat=1.5", "slope=15")
    together = np.reshape([episode_costs(each) for each in walked(members, pair, seeds, "search", 120)], (2, 2, 2))
    for exercise, member in np.ndindex(2, 2):
        (alone,) = walked([members[member]], [pair[exercise]], seeds, "search", 120)
        np.testing.assert_array_equal(together[exercise, member], episode_costs(alone))
    np.testing.assert_allclose(candidate_costs(members, pair, seeds, 120, 2), together.mean(axis=(0, 2)))


def kind_of(name):
    """Class of a subject's parameters."""
    return type(policies.make(name).parameters)


def told(text, kind):
    """The parameters before and after that an account tells of."""
    cells = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
    rows = {row[1]: row for row in cells if len(row) == 6 and row[1] in limits_of(kind)}
    return tuple(kind(**{name: float(row[column]) for name, row in rows.items()}) for column in (3, 4))


@each_subject
def test_the_parameters_in_force_are_those_that_the_account_says(name):
    """Those of a policy that has not been searched are the defaults."""
    subject, kind = POLICIES[name], kind_of(name)
    account = subject.file.path.with_name(subject.account)
    said = kind()
    if account.exists():
        before, after = told(text := account.read_text(encoding="utf-8"), kind)
        said = after if ADOPTED in text else before
    assert subject.file.in_force() == said == policies.make(name).parameters


def searched(folder, name):
    """The parameters and the account that a tiny search leaves in a folder of its own."""
    folder.mkdir()
    out = folder / "found.json"
    assert main(["search", "feedback", *TINY.split(), "--policy", name, "--out", str(out)]) == 0
    return json.loads(out.read_text(encoding="utf-8")), (folder / POLICIES[name].account).read_text(encoding="utf-8")


@pytest.mark.usefixtures("brief_judgement")
def test_a_search_writes_parameters_their_account_and_its_trials_and_is_the_same_again(tmp_path):
    name = "trot_integral"
    parameters, account = searched(tmp_path / "one", name)
    assert (parameters, account) == searched(tmp_path / "two", name)
    (trials,) = map(json.loads, (tmp_path / "one/found.trials.jsonl").read_text(encoding="utf-8").splitlines())
    costs = [each.pop("cost") for each in trials["tried"]]
    again = [BASES[name].make(parameters=kind_of(name)(**each)) for each in trials["tried"]]
    seeds = episode_seeds("search", 0, 1)
    np.testing.assert_allclose(candidate_costs(again, ["flat=1.5"], seeds, 101, 1), costs)
    assert np.ptp(costs) > 0.0
    kind, in_force, ranges = kind_of(name), policies.make(name).parameters, POLICIES[name].ranges
    before, after = told(account, kind)
    assert before == in_force != after
    assert kind(**parameters) == (after if ADOPTED in account else before)
    fixed = limits_of(kind).keys() - ranges.keys()
    assert fixed
    assert all(f"| {each} | fixed |" in account for each in fixed)
    assert f"train search feedback --policy {name} --seed 0 --generations 1 " in account
    rows = [line.split(" | ")[:3] for line in account.splitlines() if "/2 | " in line]
    assert [row[:2] for row in rows] == [["| flat=1.5", "before"], ["| flat=1.5", "after"]]


@pytest.mark.usefixtures("brief_judgement")
def test_an_outcome_that_is_no_better_on_validation_episodes_leaves_those_in_force(tmp_path, monkeypatch):
    in_force = policies.make("trot_feedback").parameters
    worse = dataclasses.replace(in_force, forward_gain=0.4, integral_gain=0.0)
    seen, real = [], feedback.walked
    monkeypatch.setattr(feedback, "walked", lambda *walk, **options: seen.append(walk[2:4]) or real(*walk, **options))
    out, start = tmp_path / "found.json", tmp_path / "start.json"
    start.write_text(json.dumps(dataclasses.asdict(worse)), encoding="utf-8")
    words = [*TINY.split(), "--generations", "0", "--start", str(start), "--out", str(out)]
    assert main(["search", "feedback", *words]) == 0
    assert json.loads(out.read_text(encoding="utf-8")) == dataclasses.asdict(in_force)
    assert KEPT in (tmp_path / "TROT_FEEDBACK.md").read_text(encoding="utf-8")
    for seeds, ground in seen:
        np.testing.assert_array_equal(seeds, episode_seeds("validation", 0, 2))
        assert ground == "validation"


def test_an_outcome_is_better_where_it_costs_less_on_most_seeds_and_not_by_chance():
    assert is_better(np.full(8, -1.0))  # all of 2^8 signs but two cost less: p = 2 / 256
    assert not is_better(np.full(8, 1.0))
    assert not is_better(np.array([-2.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0]))
