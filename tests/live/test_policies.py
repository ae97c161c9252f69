"""`python -m quad_env policies` lists every policy, and the training of the trained ones."""

import json
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

import policies
from policies import shipped
from policies.bundle import save
from quad_env.__main__ import main
from quad_env.robots.registry import MODEL_PACKAGE, get_robot


def listed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["policies", *arguments]) == 0
    return capsys.readouterr().out


def test_every_policy_is_listed_once_with_its_line_and_trained_ones_with_base_steps_and_seed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    said = listed(capsys)
    lines = [line.split(maxsplit=1) for line in said.splitlines() if line[:2] == "  " and line[2] != " "]
    assert sorted(name for name, _ in lines) == sorted(policies.names())
    assert all(line == policies.summary(name) for name, line in lines)
    for robot in ("go1", "go2") if find_spec(MODEL_PACKAGE) else ():
        said_of_robot = listed(capsys, "--robot", robot).split("\ntrained for")[1]
        shown = [line.split()[0] for line in said_of_robot.splitlines() if line[:2] == "  " and line[2] != " "]
        assert shown == list(policies.trained_names(get_robot(robot)))
    training = json.loads((shipped.MODELS / "residual" / "policy.json").read_text(encoding="utf-8"))["training"]
    assert f"base {training['base']}, at most 0.3 rad a joint; {training['steps']:,} steps of training, seed 0" in said


def test_a_student_is_listed_with_its_teacher_and_labels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = policies.load(shipped.MODELS / "residual")
    monkeypatch.setattr(shipped, "MODELS", tmp_path)
    for name, training in (
        ("student", {"teacher": "mpc_wbc", "labels": 1200, "seed": 0, "mixture": [["flat", 1.0]]}),
        ("robust", {"recipe": "improve", "steps": 7, "seed": 0, "mixture": [["flat", 1.0]]}),
    ):
        save(shipped.MODELS / name, policy, training, "revision")
    said = " ".join(listed(capsys).split())
    assert f"student {policies.summary('student')} base trot_integral, at most 0.3 rad a joint; 1,200 labels of" in said
    assert "learned the actions of mpc_wbc and runs alone" in policies.summary("student")
    assert f"robust {policies.summary('robust')} base" in said
    assert "improved by PPO" in policies.summary("robust")


def test_another_robots_trained_policies_are_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.xml"
    shutil.copy(policies.Stand().robot.mjcf, mine)
    assert "none: python -m train --robot" in listed(capsys, "--robot", str(mine))
    shutil.copytree(shipped.MODELS / "residual", tmp_path / "mine" / "walker")
    said = listed(capsys, "--robot", str(mine))
    assert "walker " in said
    assert "walker" in policies.names(mine)
    assert "robust " not in said
    (tmp_path / "mine" / "walker" / "policy.json").write_text("{", encoding="utf-8")
    assert "policy.json is not JSON" in listed(capsys, "--robot", str(mine))
