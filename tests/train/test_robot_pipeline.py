"""The complete pipeline with a user's robot: every stage writes its result, and no stage runs twice."""

import json
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import pytest

import policies
from evaluate.cells import evaluation_seeds
from quad_env.cli.command_line import UsageError
from quad_env.robots.registry import get_robot
from quad_env.seeding import episode_seeds
from tests.batches import Batch, begun
from tests.quad_env.robots.alike import alike
from tests.quad_env.robots.made import Made
from tests.seams import replace_report
from train.__main__ import main
from train.commands import robot as robot_pipeline
from train.run_record import load_config
from train.search import trials

BRIEF = replace(robot_pipeline.SEARCH, generations=1, candidates=4, episodes=8, steps=101, check_episodes=4)
TRAINING = (
    "--ppo.envs 8 --ppo.rollout-steps 8 --ppo.minibatch 64 --max-episode-steps 16 --mixture flat 1.0 "
    "--validation.episodes 1"
)


def words(robot: Path, out: Path) -> list[str]:
    given = (
        f"robot {robot} --out {out} --learner residual --steps 64 --base trot "
        "--policies trot residual --scenarios flat push --episodes 2 --seed 3 --threads 1"
    )
    return [*given.split(), f"--training={TRAINING}"]


@pytest.fixture(scope="module", autouse=True)
def _brief_report() -> Iterator[None]:
    """Leave out the page, which has its own tests, since its films take long."""
    with pytest.MonkeyPatch.context() as patch:
        replace_report(patch, lambda _, path, **__: path.write_text("a page"))
        yield


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory, simulated: list[Batch]) -> tuple[Path, list[str], int]:
    folder = tmp_path_factory.mktemp("mine")
    robot, found = alike(folder), words(folder / "alike.xml", folder / "out")
    assert robot.source == folder / "alike.xml"
    with pytest.MonkeyPatch.context() as patch, begun() as batches:
        patch.setattr(robot_pipeline, "SEARCH", BRIEF)
        true_run = trials.run_each  # the fit and the comparison of the search walk for 10 s
        patch.setattr(trials, "run_each", lambda *args, **options: true_run(*args, **options | {"steps": BRIEF.steps}))
        code = main(found)
    simulated += batches
    return folder / "out", found, code


@pytest.fixture(scope="module")
def simulated() -> list[Batch]:
    """Return the list that collects the simulated batches of the pipeline."""
    return []


def test_every_stage_leaves_its_outcome(walked: tuple[Path, list[str], int]) -> None:
    out, _, code = walked
    assert code == 0
    assert (out / "evaluation" / "report.html").is_file()
    robot = get_robot(str(out / "alike.toml"))
    assert robot.sha256 == get_robot(str(out.parent / "alike.xml")).sha256
    own = out / "alike"
    assert json.loads((own / "trot.json").read_text(encoding="utf-8")) == vars(
        policies.make("trot", robot=robot).parameters
    )
    assert f"--robot {out / 'alike.toml'}" in (own / "TROT.md").read_text(encoding="utf-8")
    assert policies.make("residual", robot=robot).base.parameters == policies.make("trot", robot=robot).parameters
    results = json.loads((out / "evaluation" / "results.json").read_text(encoding="utf-8"))
    assert results["provenance"]["hardware"]["robot"] == str(out / "alike.toml")
    assert results["policies"]["residual"]["scenarios"]["push"]["severity"] == pytest.approx(35.0 * 0.1 * 0.4**0.5)


def test_every_option_reaches_its_stage(walked: tuple[Path, list[str], int], simulated: list[Batch]) -> None:
    out, found, _ = walked
    given = {word.partition("=")[0].removeprefix("--") for word in found if word.startswith("--")} | {"robot"}
    other = robot_pipeline.LEARNER_OPTIONS["student"]
    assert given == {field.name for field in fields(robot_pipeline.RobotPipelineOptions)} - set(other), (
        "an option that nothing here looks at"
    )
    by_purpose = {each.purpose: each for each in reversed(simulated)}
    assert by_purpose.keys() == {"search", "training", "validation", "evaluation"}
    for purpose, seeds in {
        "search": episode_seeds("search", 3, BRIEF.episodes).tolist() * BRIEF.candidates,
        "training": episode_seeds("training", 3, 8).tolist(),
        "evaluation": evaluation_seeds(3, 2).tolist() * 2,  # two policies share the batch
    }.items():
        assert list(by_purpose[purpose].seeds) == seeds
    assert {(each.env.robot.name, each.threads) for each in simulated} == {("alike", 1)}
    settings = load_config(out / "training")
    assert (settings.base, settings.steps, settings.seed) == ("trot", 64, 3)
    assert (settings.max_episode_steps, settings.ppo.envs) == (16, 8)  # as given by --training
    results = json.loads((out / "evaluation" / "results.json").read_text())
    assert (results["seed"], results["episodes"]) == (3, 2)
    cells = {name: list(each["scenarios"]) for name, each in results["policies"].items()}
    assert cells == {"trot": ["flat", "push"], "residual": ["flat", "push"]}


def test_what_is_done_is_not_done_again(
    walked: tuple[Path, list[str], int], capsys: pytest.CaptureFixture[str]
) -> None:
    out, found, _ = walked
    files = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    assert main(found) == 0
    assert capsys.readouterr().out.count("done already") == 4
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()} == files
    (out / "evaluation" / "results.json").unlink()
    assert main(found) == 0
    assert capsys.readouterr().out.count("done already") == 3
    assert (out / "evaluation" / "results.json").is_file()


def test_another_way_does_not_go_on_in_its_folder(
    walked: tuple[Path, list[str], int], capsys: pytest.CaptureFixture[str]
) -> None:
    out, found, _ = walked
    assert main([*found, "--base", "trot_integral"]) == 2
    assert "was started with other options (base): choose another --out" in capsys.readouterr().err
    elsewhere = out.parent / "elsewhere"
    elsewhere.mkdir()
    alike(elsewhere)
    assert main([found[0], str(elsewhere / "alike.xml"), *found[2:]]) == 2
    assert "started with other options (robot)" in capsys.readouterr().err


def test_ctrl_c_says_how_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alike(tmp_path)

    def stop(_: object) -> int:
        raise KeyboardInterrupt("kept what was found")

    monkeypatch.setattr(robot_pipeline.trot, "main", stop)
    monkeypatch.setattr(sys, "argv", ["train", "robot", "my robot.xml"])
    options = robot_pipeline.RobotPipelineOptions(
        robot=str(tmp_path / "alike.xml"), learner="residual", out=tmp_path / "out"
    )
    with pytest.raises(KeyboardInterrupt) as said:
        robot_pipeline.main(options)
    assert str(said.value) == "kept what was found; continue with: python -m train robot 'my robot.xml'"
    assert (tmp_path / "out" / "alike.toml").is_file()


@pytest.mark.parametrize("made", [Made(torque=None), Made(hinges=2)])
def test_a_robot_that_cannot_be_used_ends_it_before_anything_is_searched(
    made: Made, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    options = robot_pipeline.RobotPipelineOptions(robot=str(made.write(tmp_path)), out=tmp_path / "out")
    with pytest.raises(UsageError, match="cannot be used as it is"):
        robot_pipeline.main(options)
    assert len(capfd.readouterr().err.splitlines()) == 2  # the reason, and the place to give the missing value
    assert (tmp_path / "out" / "inferred.toml").is_file()
    (tmp_path / "out" / "inferred.toml").write_text("# mine", encoding="utf-8")
    with pytest.raises(UsageError, match="has gaps to fill"):
        robot_pipeline.main(options)
    assert (tmp_path / "out" / "inferred.toml").read_text(encoding="utf-8") == "# mine"
    assert not (tmp_path / "out" / "made.toml").exists()
