"""A student of several training seeds, and the policies that PPO makes of them, are published with their cards."""

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.analysis.results import null_to_nan
from evaluate.records.store import read_run
from evaluate.records.training_run import load_settings
from evaluate.statistics.training_seeds import mean_interval
from policies.base import PolicyError
from policies.bundle import copy
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import points_with, share
from research.__main__ import main
from research.training.trained_run import TrainedRun, find_origin, load_trained_run, teacher_settings
from tests.robot_models import NEEDS_MODELS
from train.__main__ import main as train
from train.config import RECIPES

DISTILLATION = (
    "--teacher trot --labels 400 --envs 10 --round-steps 20 --segment-rounds 1 --max-episode-steps 30 --threads 1 "
    "--mixture flat 0.5 push 0.5 --inputs.lags 0.02 --inputs.averages 0.5 --fit.hidden 8 --fit.round-updates 4 "
    "--fit.final-updates 4 --fit.minibatch 32 --validation.episodes 1 --validation.scenarios flat "
    "--validation.interval 0"
)
IMPROVEMENT = (
    "--policy end-to-end --recipe improve --servo stiff --threads 1 --mixture flat 1.0 --steps 64 --ppo.envs 8 "
    "--ppo.rollout-steps 4 --ppo.minibatch 32 --ppo.epochs 1 --ppo.critic 8 --ppo.critic-steps 0 "
    "--validation.episodes 1 --validation.scenarios flat --validation.interval 0 --max-episode-steps 30"
)
SEEDS = (0, 1)
EVALUATION = "--episodes 2 --threads 1 --scenarios flat push steady"


@pytest.fixture(scope="module")
def students(tmp_path_factory):
    """Return the run folders of two training seeds of a student."""
    folder = tmp_path_factory.mktemp("students")
    for seed in SEEDS:
        assert train([*DISTILLATION.split(), "--seed", str(seed), "--out", str(folder / str(seed))]) == 0
    return [folder / str(seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def improved(students, tmp_path_factory):
    """Return the run folders of two training seeds of PPO, each of which starts with the student of its seed."""
    folder = tmp_path_factory.mktemp("improved")
    for seed, student in zip(SEEDS, students, strict=True):
        words = ["--start", str(student), "--seed", str(seed), "--out", str(folder / str(seed))]
        assert train([*IMPROVEMENT.split(), *words]) == 0
    return [folder / str(seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def models(students, improved, tmp_path_factory):
    """Return a models folder to which student and improved policy are published, and the folder of the evaluations."""
    folder = tmp_path_factory.mktemp("published")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(policies.shipped, "MODELS", folder / "models")
        for name, runs in (("student", students), ("robust", improved)):
            words = [*map(str, reversed(runs)), "--policy", name, "--out", str(folder / name), *EVALUATION.split()]
            assert main(["publish", *words]) == 0
    return folder


def card_of(models: Path, name: str) -> str:
    return (models / "models" / name / "MODEL.md").read_text(encoding="utf-8")


def results_of(models: Path, name: str):
    return null_to_nan(json.loads((models / name / "results.json").read_text(encoding="utf-8")))


def columns(card: str, scenario: str, section: str = "## Results") -> dict[str, str]:
    """Return the cells of a scenario in the first table of a section: heading -> text."""
    lines = card.split(section)[1].splitlines()
    (heads, *_) = (line for line in lines if line.startswith("| scenario |"))
    (row, *_) = (line for line in lines if line.startswith(f"| {scenario} |"))
    cells = ([cell.strip() for cell in line.strip("|").split("|")] for line in (heads, row))
    return dict(zip(*cells, strict=True))


def success(models: Path, name: str, scenario: str) -> dict[str, np.ndarray]:
    """Return the success of each episode of a scenario: policy -> (n,)."""
    cells = read_run(models / name).cells
    return {cell.policy: cell.measures.succeeded.astype(float) for cell in cells if cell.scenario.name == scenario}


@pytest.mark.parametrize("name", ["student", "robust"])
def test_the_policy_of_seed_0_is_published_with_the_command_revision_and_times_of_its_run(
    name, models, students, improved
):
    run = (students if name == "student" else improved)[0]
    bundle, card = models / "models" / name, card_of(models, name)
    assert sorted(path.name for path in bundle.iterdir()) == ["MODEL.md", "policy.json", "policy.safetensors"]
    assert (bundle / "policy.safetensors").read_bytes() == (run / "best" / "policy.safetensors").read_bytes()
    (printed,) = re.findall(r"^    (python -m train .*)$", card, re.MULTILINE)
    assert printed == json.loads((run / "run.json").read_bytes())["command"]
    revision = json.loads((run / "best" / "policy.json").read_bytes())["git_revision"]
    assert f"source {revision}. " in card
    assert "where the command has these settings too" in card
    checkpoint = json.loads(max((run / "checkpoints").glob("*.json")).read_bytes())["remembered"]
    times = f"{checkpoint['cpu_seconds'] / 60:.1f} min of processor time in {checkpoint['seconds'] / 60:.1f} min"
    assert checkpoint["cpu_seconds"] > 0.0
    assert times in card
    assert ("400 labels of `trot` from 10 robots" in card) == (name == "student")
    assert ("64 steps of 8 robots" in card) == (name == "robust")


@pytest.mark.parametrize("name", ["student", "robust"])
def test_the_card_says_what_the_network_reads_its_servo_gains_time_and_gait(name, models):
    card, policy = card_of(models, name), policies.load(models / "models" / name)
    assert f"The network reads {policy.network.sizes[0]} numbers: the observation, a clock of" in card
    assert f"The policy commands servos of {policy.robot.servo}." in card
    times = re.findall(r"`(\w+)` ([\d.]+)\u00a0ms", card.split("## Time of an action")[1])
    assert [label for label, _ in times] == ([name, "trot"] if name == "student" else [name, "trot", "start"])
    assert all(float(milliseconds) > 0.0 for _, milliseconds in times)
    gait = card.split("## Gait")[1]
    effort = results_of(models, name)["policies"]["trot"]["scenarios"]["steady"]["effort"]
    assert f"| `trot` | {success_speed(models, name):.2f} | {effort['step_rate']:.2f} |" in gait
    assert f"<!-- gaits simple_quad {name} -->\n<!-- /gaits -->" in gait


def success_speed(models: Path, name: str) -> float:
    """Return the mean forward velocity of the trot on the steady walk, m/s."""
    (cell,) = (c for c in read_run(models / name).cells if (c.policy, c.scenario.name) == ("trot", "steady"))
    return float(np.nanmean(cell.measures.mean_velocities[..., 0]))


@pytest.mark.parametrize("scenario", ["flat", "push"])
def test_figures_of_a_student_are_those_of_the_evaluation_against_its_teacher(scenario, models, students):
    results, cells = results_of(models, "student"), columns(card_of(models, "student"), scenario)
    by_policy = {name: each["scenarios"][scenario] for name, each in results["policies"].items()}
    for heading, policy in (("success, `trot`", "trot"), ("success, student 0 (shipped)", str(students[0]))):
        summary = by_policy[policy]
        assert cells[heading] == share(summary["success_rate"], summary["success_rate_ci"])
    (group,) = results["groups"]
    assert group["policies"] == [str(run) for run in reversed(students)]
    rate = group["scenarios"][scenario]
    assert cells["mean of 2 seeds"] == share(rate["success_rate"], rate["success_rate_ci"])
    by_episode = success(models, "student", scenario)
    values = np.array([by_episode[str(run)] - by_episode["trot"] for run in students])
    expected = points_with(float(values.mean()), mean_interval(values, (-1.0, 1.0))).with_interval
    assert cells["difference of this mean, points"] == expected
    (compared,) = (
        each
        for each in results["comparisons"]
        if (each["scenario"], each["a"], each["b"], each["metric"])
        == (scenario, str(students[0]), "trot", "success_rate")
    )
    difference = points_with(compared["difference"], compared["ci"]).with_interval
    assert cells["student 0 (shipped) minus `trot`, points"].startswith(f"{difference} (p")


def test_the_scores_have_the_mean_of_the_seeds_with_the_interval_of_the_evaluation(models):
    (group,) = results_of(models, "student")["groups"]
    score = points_with(group["score"]["score"], group["score"]["ci"])
    (row,) = (line for line in card_of(models, "student").splitlines() if line.startswith("| mean of 2 seeds of"))
    assert row.split(" | ")[1].split("\u00a0%")[0] == f"{score.value} [{score.interval}"


def test_an_improved_policy_is_compared_with_its_teacher_and_each_seed_with_its_own_start(models, students, improved):
    card = card_of(models, "robust")
    assert "success, `trot`" in columns(card, "flat")
    cells = columns(card, "push", "## Compared with its start")
    by_episode = success(models, "robust", "push")
    values = np.array([by_episode[str(a)] - by_episode[str(b)] for a, b in zip(improved, students, strict=True)])
    expected = points_with(float(values.mean()), mean_interval(values, (-1.0, 1.0))).with_interval
    assert cells["difference of this mean, points"] == expected
    start = results_of(models, "robust")["policies"][str(students[0])]["scenarios"]["push"]
    assert cells["success, `start`"] == share(start["success_rate"], start["success_rate_ci"])
    assert "minus `start`, % points" in card
    assert re.search(r"^\| `start` \| 0\.0 [^|]* \| – \|$", card.split("minus `start`, % points")[1], re.MULTILINE)


def test_published_policies_are_made_by_name(models, monkeypatch):
    monkeypatch.setattr(policies.shipped, "MODELS", models / "models")
    assert {"student", "robust"} <= set(policies.names())
    for name in ("student", "robust"):
        policy = policies.make(name, servo="own")
        policy.reset(2)
        assert policy.act(np.zeros((2, 48), np.float32)).shape == (2, 12)


@NEEDS_MODELS
def test_a_published_student_is_refused_for_another_robot(models, monkeypatch):
    with pytest.raises(PolicyError, match=r"was made for simple_quad .* not for go1"):
        policies.resolve(models / "models" / "student", robot="go1", servo="own")
    copy(models / "models" / "student", models / "go1" / "student")
    monkeypatch.setattr(policies.shipped, "MODELS", models)
    with pytest.raises(PolicyError, match=r"was made for simple_quad .* not for go1"):
        policies.make("student", robot="go1", servo="own")


def test_a_shipped_student_is_loaded_again_with_the_facts_of_its_card(models, students):
    again, run = (load_trained_run(folder) for folder in (models / "models" / "student", students[0]))
    assert (again.command, again.teacher, again.kind) == (run.command, "trot", "student")
    assert again.cpu_minutes == pytest.approx(run.cpu_minutes, abs=0.051)
    assert again.config.labels == load_settings(students[0])["labels"]
    assert shlex.split(again.command)[3:5] == ["--teacher", "trot"]


def test_the_teacher_of_a_policy_improved_twice_is_that_of_its_student(tmp_path):
    files = {"student": {"teacher": "trot", "servo": "35/0.5"}, "first": {"start": str(tmp_path / "student")}}
    for name, settings in files.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.json").write_text(json.dumps(settings), encoding="utf-8")
    config = replace(RECIPES["improve"], start=tmp_path / "first")
    origin = find_origin(tmp_path, config)
    assert origin == (str(tmp_path / "first"), "trot")
    run = TrainedRun("second", config, 1.0, "revision", tmp_path, start=origin[0], teacher=origin[1])
    assert (run.kind, run.references) == ("robust", ("trot", str(tmp_path / "first")))
    assert teacher_settings(run) == ("35/0.5", False)
    assert find_origin(tmp_path, replace(config, start=None)) == ("", "")


def test_an_unfinished_distillation_and_a_missing_start_are_one_line(students, improved, tmp_path, refused):
    unfinished = tmp_path / "unfinished"
    (unfinished / "checkpoints").mkdir(parents=True)
    for file in students[0].rglob("*.*"):
        if file.parent.name == "checkpoints" or file.name == "config.json":
            target = unfinished / file.relative_to(students[0])
            target.write_bytes(file.read_bytes().replace(b'"is_finished": true', b'"is_finished": false'))
    assert "unfinished (400 of 400 labels)" in refused(main, "publish", unfinished)
    lost = tmp_path / "lost"
    for file in improved[0].rglob("*.*"):
        (lost / file.relative_to(improved[0])).parent.mkdir(parents=True, exist_ok=True)
        content = file.read_bytes()
        if file.name == "config.json":
            content = content.replace(str(students[0]).encode(), b"gone/student")
        (lost / file.relative_to(improved[0])).write_bytes(content)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(policies.shipped, "MODELS", tmp_path)
        with pytest.raises(UsageError, match="its --start cannot be read, got gone/student"):
            load_trained_run(lost)
    assert "unknown kind of policy, got waltz" in refused(main, "publish", students[0], "--policy", "waltz")
