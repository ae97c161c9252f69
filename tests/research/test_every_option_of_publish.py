"""Every option of `python -m train export` and `publish` reaches what it governs, each given other than usual."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from tests.train.shipping import test_publish

from policies import Trot, bundle
from policies.network import Network
from policies.residual import Features, ResidualPolicy
from quad_env.seeding import episode_seeds
from research.training import publish
from tests.effects import Called, Effect, check_all, check_other_than_usual, robots
from tests.quad_env.robots.alike import alike
from train import export
from train.__main__ import main

SEEDS = tuple(episode_seeds("evaluation", 5, 3).tolist())


def exported(made: Called, key: str) -> Any:
    """What the file says of the policy."""
    assert made.code == 0
    (found,) = onnx.load(made.folder / "new/walker.onnx").metadata_props
    return json.loads(found.value)[key]


def names(made: Called) -> list[str]:
    """Of the policies that are evaluated."""
    return [Path(each).name for each in made.of("resolve", "name_or_path")]


def card(made: Called) -> str:
    assert made.code == 0
    return (made.folder / "new/walker/MODEL.md").read_text("utf-8")


EFFECTS = {
    "export": {
        "folder": Effect("FOLDER/mine", lambda made: exported(made, "hold"), 3),
        "robot": Effect("--robot FOLDER/alike.xml", lambda made: exported(made, "robot"), "alike"),
        "out": Effect("--out FOLDER/new/walker.onnx", lambda made: "new/walker.onnx: as the bundle" in made.said, True),
    },
    "publish": {
        "runs": Effect("MODELS/end_to_end", names, ["crouch", "end_to_end"]),
        "to": Effect("--to FOLDER/new/walker", lambda made: card(made).split("\n")[0], "# walker"),
        "policy": Effect("--policy end-to-end", lambda made: "| success, walker 0 (shipped) |" in card(made), True),
        "scenarios": Effect(
            "--scenarios push slope", robots(lambda each: each.env.scenario.name), ["push"] * 2 + ["slope"] * 2
        ),
        "episodes": Effect("--episodes 3", lambda made: "3 episodes of 10 s a scenario" in card(made), True),
        "seed": Effect("--seed 5", robots(lambda each: each.seeds), [SEEDS] * 4),
        "out": Effect(
            "--out FOLDER/new/out",
            lambda made: made.done and json.loads((made.folder / "new/out/results.json").read_bytes())["seed"],
            5,
        ),
        "threads": Effect("--threads 1", robots(lambda each: each.threads), [1] * 4),
    },
}
ELSEWHERE = {"publish": {"resume": test_publish.test_a_stopped_publishing_goes_on_where_it_was}}
"""Options with a test of their own, which gives them."""
OPTIONS = {"export": export.Options, "publish": publish.Options}


@pytest.mark.parametrize("command", EFFECTS)
def test_options_reach_what_they_govern(
    command: str, tmp_path: Path, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("evaluate.rollouts.rollout.STEPS", 130)
    base = Trot(robot=alike(tmp_path))
    network = Network((np.ones((Features(base).width, 12), np.float32),), (np.zeros(12, np.float32),), "tanh")
    bundle.save(tmp_path / "mine", ResidualPolicy(base, network, hold=3), {}, "0" * 40)
    effects = EFFECTS[command]
    assert {each.name for each in fields(OPTIONS[command])} == effects.keys() | ELSEWHERE.get(command, {}).keys()
    text = " ".join(each.words for each in effects.values())
    words = text.replace("FOLDER", str(tmp_path)).replace("MODELS", str(repository / "models")).split()
    check_other_than_usual(OPTIONS[command], words, effects)
    made = Called(main, [command, *words], tmp_path)
    check_all(effects, made)
