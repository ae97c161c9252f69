"""The search for success: its scenarios, its cost, its files, and the adopted parameters."""

import dataclasses
import json
import re

import numpy as np
import pytest

import policies
from evaluate.measures.metrics import measure
from policies.parameters import limits_of
from quad_env.seeding import episode_seeds
from research.__main__ import main
from research.training.search import ADOPTED, KEPT, POLICIES, FeedbackSearchOptions, adoption_decision
from tests.batches import begun
from tests.quad_env.robots.alike import alike
from train.search import trials
from train.search.trials import episode_costs, run_candidates

TINY = "--generations 1 --candidates 4 --episodes 1 --steps 101 --check-episodes 2 --threads 1 --exercises flat=1.5"
each_subject = pytest.mark.parametrize("name", POLICIES)


@pytest.fixture
def brief_judgement(monkeypatch):
    true_run = trials.run_each
    monkeypatch.setattr(trials, "run_each", lambda *walk, **options: true_run(*walk, **options | {"steps": 101}))


def kind_of(name):
    """Return the class of a policy's parameters."""
    return type(policies.make(name).parameters)


def told(text, kind):
    """Return the parameters before and after the search of an account, including later manual changes."""
    cells = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
    rows = {row[1]: row for row in cells if len(row) == 6 and row[1] in limits_of(kind)}
    by_hand = next((line for line in text.splitlines() if line.startswith("Set by hand since:")), "").partition(". ")[0]
    later = {name: float(value) for name, value in re.findall(r"`(\w+)` ([-\d.]+\d|\d)", by_hand)}
    return tuple(kind(**{name: float(row[column]) for name, row in rows.items()} | later) for column in (3, 4))


@each_subject
def test_the_parameters_in_force_are_those_that_the_account_says(name):
    """A policy without a search has the default parameters."""
    subject, kind = POLICIES[name], kind_of(name)
    account = subject.file.path.with_name(subject.account_name)
    said = kind()
    if account.exists():
        before, after = told(text := account.read_text(encoding="utf-8"), kind)
        said = after if ADOPTED in text else before
    assert subject.file.load_for_robot() == said == policies.make(name).parameters


def searched(folder, name):
    """Return the parameters and the account of a tiny search in its own folder."""
    folder.mkdir()
    out = folder / "found.json"
    assert main(["search", *TINY.split(), "--policy", name, "--out", str(out)]) == 0
    return json.loads(out.read_text(encoding="utf-8")), (folder / POLICIES[name].account_name).read_text(
        encoding="utf-8"
    )


@pytest.mark.usefixtures("brief_judgement")
def test_a_search_writes_parameters_their_account_and_its_trials_and_is_the_same_again(tmp_path):
    name = "trot_integral"
    parameters, account = searched(tmp_path / "one", name)
    assert (parameters, account) == searched(tmp_path / "two", name)
    (found,) = map(json.loads, (tmp_path / "one/found.trials.jsonl").read_text(encoding="utf-8").splitlines())
    costs = [each.pop("cost") for each in found["tried"]]
    again = [kind_of(name)(**each) for each in found["tried"]]
    (walk,) = run_candidates(name, again, ["flat=1.5"], episode_seeds("search", 0, 1), "search", 101)
    np.testing.assert_allclose(episode_costs(measure(walk)), costs)
    assert np.ptp(costs) > 0.0
    kind, in_force, ranges = kind_of(name), policies.make(name).parameters, POLICIES[name].ranges
    before, after = told(account, kind)
    assert before == in_force != after
    assert kind(**parameters) == (after if ADOPTED in account else before)
    fixed = limits_of(kind).keys() - ranges.keys()
    assert fixed
    assert all(f"| {each} | fixed |" in account for each in fixed)
    assert "research search --seed 0 --generations 1 " in account
    rows = [line.split(" | ")[:3] for line in account.splitlines() if "/2 | " in line]
    assert [row[:2] for row in rows] == [["| flat=1.5", "before"], ["| flat=1.5", "after"]]


@pytest.mark.usefixtures("brief_judgement")
def test_an_outcome_that_is_no_better_on_validation_episodes_leaves_those_in_force(tmp_path, monkeypatch):
    in_force = policies.make("trot_feedback").parameters
    worse = dataclasses.replace(in_force, forward_damping=0.2, tilt_damping=0.0)
    seen, real = [], run_candidates
    monkeypatch.setattr(
        trials, "run_candidates", lambda *walk, **options: seen.append(walk[3:5]) or real(*walk, **options)
    )
    out, start = tmp_path / "found.json", tmp_path / "start.json"
    start.write_text(json.dumps(dataclasses.asdict(worse)), encoding="utf-8")
    words = [*TINY.split(), "--generations", "0", "--start", str(start), "--out", str(out)]
    assert main(["search", *words]) == 0
    assert json.loads(out.read_text(encoding="utf-8")) == dataclasses.asdict(in_force)
    assert KEPT in (tmp_path / "TROT_FEEDBACK.md").read_text(encoding="utf-8")
    for seeds, ground in seen:
        np.testing.assert_array_equal(seeds, episode_seeds("validation", 0, 2))
        assert ground == "validation"


def test_an_outcome_is_better_where_it_costs_less_on_most_seeds_and_not_by_chance():
    assert adoption_decision(np.full(8, -1.0))[0]  # all but two of 2^8 sign patterns cost less: p = 2 / 256
    assert not adoption_decision(np.full(8, 1.0))[0]
    assert not adoption_decision(np.array([-2.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0]))[0]


def test_every_option_reaches_the_robots_and_the_files(tmp_path):
    in_force = policies.make("trot_integral", robot=alike(tmp_path)).parameters
    ranges = POLICIES["trot_integral"].ranges
    fixed = next(name for name in dataclasses.asdict(in_force) if name not in ranges)
    begin = dataclasses.replace(in_force, **{fixed: 0.9 * getattr(in_force, fixed)})
    (tmp_path / "start.json").write_text(json.dumps(dataclasses.asdict(begin)))
    words = "--robot FOLDER/alike.xml --policy trot_integral --generations 2 --candidates 5 --episodes 2"
    words += " --exercises flat=1.5 push=42 --steps 110 --spread 0.02 --check-episodes 3 --start FOLDER/start.json"
    given = f"{words} --seed 3 --threads 1 --out FOLDER/found.json".replace("FOLDER", str(tmp_path)).split()
    names = vars(FeedbackSearchOptions()).keys() - {"ray"}  # tests/train/test_on_cluster.py
    assert {word[2:].replace("-", "_") for word in given if word.startswith("--")} == names
    with begun() as batches:
        assert main(["search", *given]) == 0
    assert {(each.threads, each.env.robot.name) for each in batches} == {(1, "alike")}
    shapes = [(each.env.scenario.name, len(each.seeds), each.env.max_episode_steps) for each in batches]
    generation = [("flat=1.5", 5 * 2, 110), ("push=42", 5 * 2, 110)]
    assert shapes[:4] == generation * 2
    assert {shape[::2] for shape in shapes[4:]} == {("flat=1.5", 1000), ("push=42", 1000)}
    seeds = list(dict.fromkeys(seed for each in batches for seed in each.seeds))
    assert seeds == [*episode_seeds("search", 3, 4), *episode_seeds("validation", 3, 3)]
    assert (tmp_path / "TROT_INTEGRAL.md").is_file()
    first, _ = [json.loads(line) for line in (tmp_path / "found.trials.jsonl").read_text().splitlines()]
    assert first["mean"][fixed] == getattr(begin, fixed) != getattr(in_force, fixed)
    low, high = ranges["integral_gain"]
    tried = [(each["integral_gain"] - begin.integral_gain) / (high - low) for each in first["tried"]]
    assert np.abs(tried).max() < 4 * 0.02


@pytest.mark.parametrize(
    ("words", "complaint"),
    [("--exercises gallop", "--exercises: unknown scenario 'gallop'"), ("--start no-such.json", "no-such.json")],
)
def test_bad_input_is_one_line(words, complaint, capsys):
    assert main(["search", *words.split()]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert complaint in line
