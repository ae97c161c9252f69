"""The pipeline that makes a student for a user's robot: every stage writes its result, and no stage runs twice."""

import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.cells import evaluation_seeds
from quad_env.cli.command_line import UsageError
from quad_env.robots.registry import get_robot
from quad_env.seeding import episode_seeds
from tests.batches import Batch, begun
from tests.quad_env.robots.alike import alike
from tests.seams import replace_report
from train import teacher_check
from train.__main__ import main
from train.commands import robot as robot_pipeline
from train.commands.robot import RobotPipelineOptions
from train.run_record import load_settings

TRAINING = (
    "--envs 10 --round-steps 20 --segment-rounds 2 --max-episode-steps 30 --mixture flat 0.5 push 0.5 "
    "--inputs.lags 0.02 --inputs.averages 0.5 --fit.hidden 8 --fit.round-updates 4 --fit.final-updates 4 "
    "--fit.minibatch 32 --validation.episodes 1 --validation.scenarios flat"
)


@pytest.fixture(scope="module", autouse=True)
def _brief_report() -> Iterator[None]:
    """Leave out the page, which has its own tests, since its films take long."""
    with pytest.MonkeyPatch.context() as patch:
        replace_report(patch, lambda _, path, **__: path.write_text("a page"))
        yield


@pytest.fixture(scope="module")
def simulated() -> list[Batch]:
    """Return the list of the batches of the whole pipeline."""
    return []


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, simulated: list[Batch]) -> tuple[Path, list[str], int]:
    """Return the output folder, the command line and the exit code of a pipeline."""
    folder = tmp_path_factory.mktemp("mine")
    alike(folder)
    given = (
        f"robot {folder / 'alike.xml'} --out {folder / 'out'} --learner student --teacher trot_feedback --labels 400 "
        "--policies trot_feedback student --scenarios flat push --episodes 2 --seed 3 --threads 1"
    )
    words = [*given.split(), f"--training={TRAINING}"]
    with begun() as batches:
        code = main(words)
    simulated += batches
    return folder / "out", words, code


def test_every_stage_writes_its_result(made: tuple[Path, list[str], int]) -> None:
    out, _, code = made
    assert code == 0
    assert (out / "evaluation" / "report.html").is_file()
    assert json.loads((out / "teacher.json").read_text())["success_rate"] >= teacher_check.MIN_SUCCESS
    robot = get_robot(str(out / "alike.toml"))
    student = policies.make("student", robot=robot)
    teacher = policies.make("trot_feedback", robot=robot)
    assert student.features.inputs.clock == teacher.frequency
    network = policies.resolve(str(out / "student.onnx"), robot=student.robot)
    observation = np.random.default_rng(0).normal(size=(3, 48)).astype(np.float32)
    for policy in (student, network):
        policy.reset(3)
    np.testing.assert_allclose(network.act(observation), student.act(observation), atol=1e-5)


def test_every_option_reaches_its_stage(made: tuple[Path, list[str], int], simulated: list[Batch]) -> None:
    out, words, _ = made
    given = {word.partition("=")[0].removeprefix("--") for word in words if word.startswith("--")} | {"robot"}
    other = robot_pipeline.LEARNER_OPTIONS["residual"]
    assert given == {field.name for field in fields(RobotPipelineOptions)} - set(other), "an option without a check"
    by_purpose = {each.purpose: each for each in reversed(simulated)}
    assert by_purpose.keys() == {"training", "validation", "evaluation"}
    assert (
        list(by_purpose["training"].seeds)
        == episode_seeds("training", 3, 10).tolist()[: len(by_purpose["training"].seeds)]
    )
    # Two policies share the last batch.
    assert list(by_purpose["evaluation"].seeds) == evaluation_seeds(3, 2).tolist() * 2
    assert {(each.env.robot.name, each.threads) for each in simulated} == {("alike", 1)}
    settings = load_settings(out / "distillation")
    assert (settings["teacher"], settings["labels"], settings["seed"]) == ("trot_feedback", 400, 3)
    assert (settings["max_episode_steps"], settings["envs"]) == (30, 10)
    results = json.loads((out / "evaluation" / "results.json").read_text())
    cells = {name: list(each["scenarios"]) for name, each in results["policies"].items()}
    assert cells == {"trot_feedback": ["flat", "push"], "student": ["flat", "push"]}


def test_no_finished_stage_runs_again(made: tuple[Path, list[str], int], capsys: pytest.CaptureFixture[str]) -> None:
    out, words, _ = made
    files = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    assert main(words) == 0
    assert capsys.readouterr().out.count("done already") == 5
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()} == files


def test_a_finished_distillation_is_only_copied(
    made: tuple[Path, list[str], int], capsys: pytest.CaptureFixture[str]
) -> None:
    out, words, _ = made
    (out / "alike" / "student" / "policy.json").unlink()
    assert main(words) == 0
    assert "round" not in capsys.readouterr().out
    assert (out / "alike" / "student" / "policy.json").is_file()


@pytest.mark.parametrize(
    ("learner", "option"), [("student", "--steps 8"), ("student", "--base trot"), ("residual", "--labels 9")]
)
def test_an_option_of_the_other_learner_is_refused(
    learner: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["robot", "simple_quad", "--learner", learner, *option.split()]) == 2
    assert f"{option.split()[0]} is an option of --learner" in capsys.readouterr().err


def test_a_folder_of_an_older_version_continues_with_a_residual(tmp_path: Path) -> None:
    options = RobotPipelineOptions(robot="simple_quad", learner="residual", out=tmp_path)
    robot_pipeline._check_same_options(options)
    file = tmp_path / robot_pipeline.OPTIONS_FILE
    stored = json.loads(file.read_text())
    file.write_text(json.dumps({name: stored[name] for name in stored if name not in robot_pipeline.OLD_OPTIONS}))
    robot_pipeline._check_same_options(options)
    student = RobotPipelineOptions(robot="simple_quad", out=tmp_path)
    with pytest.raises(UsageError, match="started with other options \\(learner, policies\\)"):
        robot_pipeline._check_same_options(student)
