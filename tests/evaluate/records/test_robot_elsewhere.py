"""The robot file of a run cannot be found from the working folder: one line names the folder to change to."""

from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.rollouts import rollout
from tests.quad_env.robots.made import Made

RUN = "--policies stand --scenarios flat --episodes 1 --robot mydog.xml --out results"


def test_the_line_names_the_folder_with_the_robot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rollout, "STEPS", 110)
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    Made().write(here, "mydog.xml")
    monkeypatch.chdir(here)
    assert main(RUN.split()) == 0
    monkeypatch.chdir(there)
    capsys.readouterr()
    assert main(["report", str(here / "results")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"its robot mydog.xml is no file in {there}; run this command in {here}" in said
    monkeypatch.chdir(here)
    assert main(["report", str(here / "results")]) == 0
