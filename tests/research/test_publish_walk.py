"""A student with deployable observations is published as `walk`: its folder, its card, its path, and its exports."""

from pathlib import Path

import pytest

import policies
from policies.gaits.policy import Gaits
from quad_env.robots.registry import get_robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.__main__ import main
from research.training.trained_run import load_trained_run
from tests.train.test_deployable import SMALL_STUDENT
from train.__main__ import main as train

ROBOT = "go2"
TRAINING = ["--teacher", "trot", "--robot", ROBOT, "--observations", "deployable", *SMALL_STUDENT]
EVALUATION = "--episodes 1 --threads 1 --scenarios flat push=50"


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the runs of two seeds, and with the models folder to which they are published."""
    folder = tmp_path_factory.mktemp("published")
    runs = [str(folder / f"run-{seed}") for seed in range(2)]
    for seed, run in enumerate(runs):
        assert train([*TRAINING, "--seed", str(seed), "--out", run]) == 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(policies.shipped, "MODELS", folder / "models")
        assert main(["publish", *runs, "--out", str(folder / "results"), *EVALUATION.split()]) == 0
    return folder


def test_its_folder_is_walk_and_the_card_says_what_it_observes(published: Path) -> None:
    assert load_trained_run(published / "run-0").kind == "walk"
    card = (published / "models" / ROBOT / "walk" / "MODEL.md").read_text(encoding="utf-8")
    assert card.startswith("# walk\n")
    assert "moves the joints from the home pose at 50 Hz" in card
    assert "the last 10 values at 50 Hz of angular velocity" in card
    assert "The policy commands servos of 25 N·m/rad and 0.5 N·m·s/rad" in card
    assert "--observations deployable" in card
    assert "| push=50 |" in card


def test_it_is_published_again_from_its_folder(published: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policies.shipped, "MODELS", published / "models")
    assert load_trained_run(published / "models" / ROBOT / "walk").kind == "walk"


def test_it_is_loaded_by_its_path_and_the_gait_keeps_its_name(published: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policies.shipped, "MODELS", published / "models")
    robot = get_robot(ROBOT)
    policy = policies.resolve(str(published / "models" / ROBOT / "walk"), robot=robot, servo="own")
    assert policy.robot.gains == pytest.approx(robot.with_servo().gains)
    assert isinstance(policies.make("walk", robot=ROBOT, servo="own"), Gaits)
    assert "walk" not in policies.trained_names(robot)


def test_a_folder_with_the_name_of_a_gait_hides_no_gait(published: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policies.shipped, "MODELS", published / "models" / ROBOT)
    # The names of SimpleQuad's bundles are those of built-in policies too.
    assert "walk" not in policies.registry._bundle_names(SIMPLE_QUAD)
