"""Every option of `python -m train export` has its effect, with a value different from its default."""

import json
import os
import shutil
import subprocess
import sys
import time
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


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the stand-alone program of an export of the shipped policy."""
    folder = tmp_path_factory.mktemp("export") / "out"
    assert main(["export", "end_to_end", "--to", "toml", "--out", str(folder)]) == 0
    return folder / "run.py"


@pytest.mark.parametrize(("words", "seconds"), [("--headless 3", 3.0), ("--headless", 10.0)])
def test_the_program_of_an_export_walks_without_this_project(words: str, seconds: float, program: Path) -> None:
    command = [sys.executable, "-I", str(program), *words.split()]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    distance, result = said.removeprefix("distance ").split(" m in ")
    # The default command is 0.6 m/s forward.
    assert 0.4 < float(distance) / seconds < 0.8
    assert result == f"{seconds} s, upright\n"


def test_the_program_of_an_export_needs_mujoco_and_onnxruntime_alone(program: Path) -> None:
    text = program.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 250
    lines = (line.strip() for line in text.splitlines())
    imported = {line.split()[1].split(".")[0] for line in lines if line.startswith(("import ", "from "))}
    # MuJoCo depends on numpy.
    assert imported - sys.stdlib_module_names == {"mujoco", "numpy", "onnxruntime"}


@pytest.mark.skipif(sys.platform != "linux", reason="a display is a variable of the environment on Linux alone")
def test_the_program_of_an_export_names_headless_where_no_window_can_open(program: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-I", str(program)]
    said = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)
    assert said.returncode == 1
    assert said.stdout == ""
    assert said.stderr == "window: no display can be opened; python run.py --headless walks without a window\n"


@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs a virtual display, of the package xvfb")
def test_the_program_of_an_export_walks_in_a_window(program: Path, tmp_path: Path) -> None:
    # The robot is thrown onto its back after 1 s, which ends the walk.
    text = program.read_text(encoding="utf-8")
    fall = "        window.sync()\n            data.qpos[3:7] = (0, 1, 0, 0) if data.time > 1.0 else data.qpos[3:7]\n"
    changed = text.replace("        window.sync()\n", fall)
    assert changed != text
    copy = program.with_name("falling.py")
    copy.write_text(changed, encoding="utf-8")
    start = time.perf_counter()
    command = ["xvfb-run", "-a", sys.executable, "-I", str(copy)]
    said = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert said.returncode == 0, said.stderr
    assert said.stdout.endswith(" m in 1.0 s, fell\n")
    assert time.perf_counter() - start > 1.0
