"""Every option of `python -m train export` has its effect, with a value different from its default."""

import json
import subprocess
import sys
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from policies import Trot, bundle
from policies.history import Inputs
from policies.network import Network
from policies.residual import Features, ResidualPolicy
from tests.effects import Called, Effect, check_all, check_other_than_usual
from tests.quad_env.robots.alike import alike
from tests.seams import short_episodes
from tests.train.export.plain_policies import make_policy
from train.__main__ import main
from train.commands import export


def exported(made: Called, key: str) -> Any:
    """Return an entry of the exported file about the policy."""
    assert made.code == 0
    (found,) = onnx.load(made.folder / "new/walker.onnx").metadata_props
    return json.loads(found.value)[key]


FILE_EFFECTS = {
    "folder": Effect("FOLDER/mine", lambda made: exported(made, "hold"), 3),
    "robot": Effect("--robot FOLDER/alike.xml", lambda made: exported(made, "robot"), "alike"),
    "out": Effect(
        "--out FOLDER/new/walker.onnx", lambda made: "new/walker.onnx: agrees with the bundle" in made.said, True
    ),
}
"""Options of an export to one ONNX file."""


def described(made: Called, key: str) -> Any:
    """Return an entry of the exported TOML."""
    assert made.code == 0
    return tomllib.loads((made.folder / "new/walker/policy.toml").read_text(encoding="utf-8"))[key]


def title(made: Called) -> str:
    """Return the first line of the exported README."""
    return (made.folder / "new/walker/README.md").read_text(encoding="utf-8").splitlines()[0]


FOLDER_EFFECTS = {
    "folder": Effect("FOLDER/mine", lambda made: round(described(made, "control_rate"), 3), 33.333),
    "robot": Effect("--robot FOLDER/alike.xml", title, "# mine for alike, toml"),
    "to": Effect("--to toml", lambda made: described(made, "network"), "policy.onnx"),
    "out": Effect("--out FOLDER/new/walker", lambda made: "new/walker: read back" in made.said, True),
}
"""Options of an export to a folder of deployment files."""


@pytest.mark.parametrize("effects", [FILE_EFFECTS, FOLDER_EFFECTS], ids=["file", "folder"])
def test_options_reach_what_they_govern(
    effects: dict[str, Effect], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short_episodes(monkeypatch, 130)
    policy = make_policy(alike(tmp_path), Inputs(clock=2.0), hold=3, gains=None)
    bundle.save(tmp_path / "mine", policy, {}, "0" * 40)
    assert {each.name for each in fields(export.ExportOptions)} == {*FILE_EFFECTS, *FOLDER_EFFECTS}
    words = " ".join(each.words for each in effects.values()).replace("FOLDER", str(tmp_path)).split()
    check_other_than_usual(export.ExportOptions, words, effects)
    check_all(effects, Called(main, ["export", *words], tmp_path))


def test_a_residual_on_a_controller_becomes_a_file_with_its_base(tmp_path: Path) -> None:
    base = Trot(robot=alike(tmp_path))
    network = Network((np.ones((Features(base).width, 12), np.float32),), (np.zeros(12, np.float32),))
    bundle.save(tmp_path / "mine", ResidualPolicy(base, network, hold=3), {}, "0" * 40)
    words = f"export {tmp_path}/mine --robot {tmp_path}/alike.xml --out {tmp_path}/new/walker.onnx"
    assert exported(Called(main, words.split(), tmp_path), "base")["name"] == "trot"


def test_the_folder_of_an_export_is_new_or_empty(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full/notes.txt").touch()
    (tmp_path / "empty").mkdir()
    for name in ("full", "full/notes.txt"):
        assert main(["export", "end_to_end", "--to", "toml", "--out", str(tmp_path / name)]) == 2
        message = f"error: --out: must be a new or an empty folder, got {tmp_path / name}\n"
        assert capsys.readouterr().err == message
    assert [each.name for each in (tmp_path / "full").iterdir()] == ["notes.txt"]
    assert main(["export", "end_to_end", "--to", "toml", "--out", str(tmp_path / "empty")]) == 0
    assert len((tmp_path / "empty/README.md").read_text(encoding="utf-8").splitlines()) == 10


def test_the_program_of_an_export_walks_without_this_project(tmp_path: Path) -> None:
    assert main(["export", "end_to_end", "--to", "toml", "--out", str(tmp_path / "out")]) == 0
    program = tmp_path / "out/run.py"
    command = [sys.executable, "-I", str(program), "--headless", "3"]
    said = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path, timeout=300).stdout
    distance, words = said.removeprefix("distance ").split(" m in ")
    # The default command is 0.6 m/s forward.
    assert 1.2 < float(distance) < 2.4
    assert words == "3.0 s, upright\n"
    text = program.read_text(encoding="utf-8")
    imported = {line.split()[1].split(".")[0] for line in text.splitlines() if line.startswith(("import ", "from "))}
    assert imported == {"argparse", "time", "collections", "pathlib", "mujoco", "numpy", "onnxruntime"}
