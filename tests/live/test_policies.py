"""`python -m quad_env policies` lists every policy, and the training of the trained ones."""

import json
import shutil
from pathlib import Path

import pytest

import policies
from policies import shipped
from quad_env.__main__ import main


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
    training = json.loads((shipped.MODELS / "residual" / "policy.json").read_text(encoding="utf-8"))["training"]
    assert f"base {training['base']}, at most 0.3 rad a joint; {training['steps']:,} steps of training, seed 0" in said


def test_another_robots_trained_policies_are_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.xml"
    shutil.copy(policies.Stand().robot.mjcf, mine)
    assert "none: python -m train --robot" in listed(capsys, "--robot", str(mine))
    shutil.copytree(shipped.MODELS / "residual", tmp_path / "mine" / "walker")
    said = listed(capsys, "--robot", str(mine))
    assert "walker " in said
    assert "robust " not in said
    (tmp_path / "mine" / "walker" / "policy.json").write_text("{", encoding="utf-8")
    assert "policy.json is not JSON" in listed(capsys, "--robot", str(mine))
