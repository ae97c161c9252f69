"""A sighted student is published as `sighted`: its folder, its card, its default scenarios, and its use by name."""

from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import policies
from quad_env import HeightScan
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scenario
from research.__main__ import main
from research.training.publish import SCENARIOS, default_scenarios
from research.training.trained_run import TrainedRun, load_trained_run
from tests.train.distillation.test_sighted_run import COMMON, SCAN, SCAN_OPTIONS
from train.__main__ import main as train
from train.distillation.config import DistillationConfig

EVALUATION = "--episodes 1 --threads 1 --scenarios rough=0.24 rough=0.24+scan_lost"


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the models folder to which a run with --sighted is published, next to a copy of its run folder."""
    folder = tmp_path_factory.mktemp("published")
    words = f"--teacher mpc_wbc_sighted --sighted {SCAN_OPTIONS} {COMMON} --labels 200 --out {folder / 'run'}"
    assert train(words.split()) == 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(policies.shipped, "MODELS", folder / "models")
        assert main(["publish", str(folder / "run"), "--out", str(folder / "results"), *EVALUATION.split()]) == 0
    return folder


def test_its_folder_is_named_by_its_kind_and_the_card_says_what_it_sees(published: Path) -> None:
    assert load_trained_run(published / "run").kind == "sighted"
    card = (published / "models" / "sighted" / "MODEL.md").read_text(encoding="utf-8")
    assert card.startswith("# sighted\n")
    assert "a height scan of the ground (4 × 3 points 0.15 m apart, noise of 0.02 m, 0.02 s late)" in card
    assert "has learned the actions of `mpc_wbc_sighted` and runs alone" in card
    for heading in ("success, `mpc_wbc_sighted`", "| rough=0.24+scan_lost |"):
        assert heading in card


def test_it_is_made_by_name_and_walks_in_an_environment_with_its_scan(
    published: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(policies.shipped, "MODELS", published / "models")
    assert policies.trained_names(SIMPLE_QUAD) == ("sighted",)
    assert "mpc_wbc_sighted, observes a height scan" in policies.summary("sighted")
    policy = policies.make("sighted", servo="own")
    env = gym.make("SimpleQuad-v0", robot=policy.robot, height_scan=policy.height_scan)
    observation, _ = env.reset(seed=0)
    policy.reset()
    for _ in range(5):
        observation, *_ = env.step(policy.act(observation))
    assert (policy.name, policy.height_scan) == ("sighted", SCAN)
    assert np.isfinite(observation).all()


def test_its_default_scenarios_have_uneven_ground_and_lost_scans() -> None:
    config = DistillationConfig(teacher="mpc_wbc_sighted", sighted=True, scan=HeightScan())
    run = TrainedRun("run", config, 1.0, "revision", Path())
    found = [scenario(name) for name in default_scenarios(run)]
    ground = {(each.axis, each.severity, each.scan_lost) for each in found}
    assert {("rough", 0.24, False), ("stairs", 0.15, False), ("rough", 0.24, True), ("stairs", 0.15, True)} <= ground
    assert any(each.scan_dropouts for each in found)
    assert any(each.hardware and each.axis == "stairs" for each in found)
    assert default_scenarios(replace(run, config=replace(config, sighted=False))) == SCENARIOS
